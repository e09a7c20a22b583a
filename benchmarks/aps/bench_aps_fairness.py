"""What one client's abuse costs another: the longest gap at a witness that gets 50 messages a second.

An autopilot, the daemon, a witness and an abuser are a process each. Times are the kernel's (`aps_witness`).
`control` is the same witness on the same autopilot without the daemon, in the same seconds: what the machine itself
costs. Beside gaps, the longest time from the autopilot to the witness's socket, where the autopilot is the clock.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.status import status_directory
from aps.status_view import ask
from benchmarks.aps.aps_sources import SOURCES, SYSID, Source, clock, line_of, process
from benchmarks.aps.aps_witness import relay, witness

LIMIT_GAP_MS: Final = 50.0
LIMIT_GROWTH_MB: Final = 20.0
GARBAGE_BYTES: Final = 5_000_000
CONNECTIONS: Final = 1000
ME: Final = "benchmarks.aps.bench_aps_fairness"


# The abuses.


def flood(port: int, seconds: float, data: bytes, limit_bytes: int = 1 << 40) -> None:
    """Send the same bytes again and again, as fast as they are taken."""
    end_s, sent = time.monotonic() + seconds, 0
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.settimeout(0.2)
        while time.monotonic() < end_s and sent < limit_bytes:
            with contextlib.suppress(TimeoutError):
                sent += connection.send(data)
            connection.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                connection.recv(1 << 16)
            connection.settimeout(0.2)


def heartbeats() -> bytes:
    """A thousand good heartbeats of a ground station."""
    mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    return bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mav)) * 1000


def stall(port: int, seconds: float) -> None:
    """Connect, and never read."""
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.connect(("127.0.0.1", port))
        time.sleep(seconds)


def connect(port: int, seconds: float) -> None:
    """Connect a thousand times, without waiting: some stay, most leave at once."""
    end_s, kept = time.monotonic() + seconds, []
    for number in range(CONNECTIONS):
        connection = socket.socket()
        connection.setblocking(False)
        connection.connect_ex(("127.0.0.1", port))
        kept.append(connection)
        if number % 20 == 19:
            time.sleep(0.02)  # the kernel takes no more at once
            for leaving in kept[-15:]:
                leaving.close()
            del kept[-15:]
    time.sleep(max(0.0, end_s - time.monotonic()))
    for connection in kept:
        connection.close()


ABUSES: Final[dict[str, Callable[[int, float], None]]] = {
    "nobody": lambda _port, seconds: time.sleep(seconds),
    "0xFD": lambda port, seconds: flood(port, seconds, b"\xfd" * 65536, GARBAGE_BYTES),
    "0xFE": lambda port, seconds: flood(port, seconds, b"\xfe" * 65536, GARBAGE_BYTES),
    "heartbeats": lambda port, seconds: flood(port, seconds, heartbeats()),
    "stall": stall,
    "connections": connect,
}


# The measure.


def resident_mb(pid: int) -> float:
    """Memory of a process, MB."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * 4096 / 1e6


@contextlib.contextmanager
def control_port(source: Source) -> Iterator[int | None]:
    """Where the control connects: the clock through a relay, a real autopilot at its second port."""
    if source.direct_port == source.port:
        with process(ME, "--role", "relay", "--port", str(source.port), first=True) as child:
            yield int(line_of(child))
    else:
        yield source.direct_port


def measure(abuse: str, seconds: float, autopilot: str = "clock") -> dict[str, Any]:
    """One abuse on a daemon of its own."""
    with SOURCES[autopilot]() as source, control_port(source) as control:
        arguments = ["aps", "--quiet", "--autopilot", f"tcp:127.0.0.1:{source.port}", "--sysid", str(SYSID)]
        with process(*arguments, "--listen", "127.0.0.1:0", first=True) as daemon:
            port = int(line_of(daemon).split("listen=127.0.0.1:")[1].split()[0])
            ports = [port] if control is None else [port, control]
            watching = ["--role", "witness", "--message", str(source.msg_id), "--seconds", str(seconds + 1.0)]
            abusing = ["--role", abuse, "--port", str(port), "--seconds", str(seconds)]
            with (
                process(ME, *abusing) as abuser,
                process(ME, *watching, "--port", *map(str, ports), first=True) as child,
            ):
                if line_of(abuser) != "READY" or line_of(child) != "READY":
                    raise RuntimeError("the abuser or the witness did not start")
                row = _abused(port, daemon, abuser, child, alone=control is None)
                return {"abuse": abuse, "autopilot": autopilot, **row}


def _abused(
    port: int,
    daemon: subprocess.Popen[str],
    abuser: subprocess.Popen[str],
    watching: subprocess.Popen[str],
    *,
    alone: bool,
) -> dict[str, Any]:
    before_mb = resident_mb(daemon.pid)
    assert abuser.stdin is not None
    print("go", file=abuser.stdin, flush=True)
    told = json.loads(line_of(watching))
    abuser.wait(60.0)  # on a busy machine it may still be at it: what is counted is of all that it does
    control = {} if alone else {f"control_{name}": value for name, value in told[1].items()}
    shown = next(answer for answer in ask(status_directory()) if answer["name"] == str(port))["statistics"]
    counted = {**shown["client_totals"], "turned_away": shown["turned_away"], "accepted": shown["accepted"]}
    return {**told[0], **control, "growth_mb": resident_mb(daemon.pid) - before_mb, "counted": counted}


def line(row: dict[str, Any]) -> str:
    """A row for people."""
    delay = f", delay {row['delay_ms']:.1f} ({row['control_delay_ms']:.1f})" if "delay_ms" in row else ""
    control = f" ({row['control_gap_ms']:.1f})" if "control_gap_ms" in row else ""
    counted = {name: row["counted"][name] for name in SHOWN if row["counted"].get(name)}
    return (
        f"{row['autopilot']:10} {row['abuse']:12} gap {row['gap_ms']:.1f}{control} ms{delay}, "
        f"{row['messages']} messages, memory {row['growth_mb']:+.1f} MB, "
        + ", ".join(f"{name} {count}" for name, count in counted.items())
    )


SHOWN: Final = ("throttled", "skipped_bytes", "bad_crc", "stalls", "dropped_full", "turned_away", "accepted")


def main(argv: Sequence[str] | None = None) -> None:
    """Measure each abuse, print lines for people and one line of JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--abuses", nargs="+", choices=ABUSES, default=list(ABUSES))
    parser.add_argument("--autopilots", nargs="+", choices=SOURCES, default=["clock"])
    parser.add_argument("--role", choices=["clock", "witness", "relay", *ABUSES], help=argparse.SUPPRESS)
    parser.add_argument("--port", type=int, nargs="+", help=argparse.SUPPRESS)
    parser.add_argument("--message", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.role is not None:
        _play(options)
        return
    rows = [
        measure(abuse, options.seconds, autopilot)
        for autopilot in options.autopilots
        for abuse in options.abuses
    ]
    print(f"limits: gap {LIMIT_GAP_MS:g} ms, memory {LIMIT_GROWTH_MB:g} MB; in brackets the control's")
    for row in rows:
        print(line(row))
    print(json.dumps({"benchmark": "aps_fairness", "rows": rows}))


def _play(options: argparse.Namespace) -> None:
    """Be one of the processes."""
    with contextlib.suppress(OSError):
        if options.role == "clock":
            clock()
        elif options.role == "relay":
            relay(options.port[0])
        elif options.role == "witness":
            witness(options.port, options.message, options.seconds)
        else:
            print("READY", flush=True)
            sys.stdin.readline()
            ABUSES[options.role](options.port[0], options.seconds)


if __name__ == "__main__":
    main()
