"""What one client's abuse costs another: the longest gap at a witness that gets 50 messages a second.

An autopilot, the daemon, a witness and an abuser are a process each. The witness only receives and notes the time; what
it got is looked at afterwards. Beside the gap, the longest time from the autopilot's sending to its receiving. The
figures of `nobody` are what the machine itself costs.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.wire.framer import Framer

SYSID: Final = 4
RATE_HZ: Final = 50
LIMIT_GAP_MS: Final = 50.0
LIMIT_GROWTH_MB: Final = 20.0
GARBAGE_BYTES: Final = 5_000_000
CONNECTIONS: Final = 1000
FIRST_PRIORITY: Final = -15
"""Of the others than the abuser: what is measured is the daemon, not who else uses the machine."""
_SYSTEM_TIME: Final = 2


def now_us() -> int:
    """One clock for all processes of a machine."""
    return time.monotonic_ns() // 1000


# The processes.


def autopilot() -> None:
    """Send the time 50 times a second, and a heartbeat every second, to whoever connects; ignore what comes."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        print(server.getsockname()[1], flush=True)
        connection, _ = server.accept()
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    mav = mavlink.MAVLink(None, srcSystem=SYSID, srcComponent=1)
    due_s = time.monotonic()
    for number in range(1_000_000):
        message = mavlink.MAVLink_system_time_message(now_us(), number * 20)
        data = bytes(message.pack(mav))
        if number % RATE_HZ == 0:
            data += bytes(mavlink.MAVLink_heartbeat_message(2, 3, 0x59, 4, 4, 3).pack(mav))
        connection.setblocking(True)
        connection.sendall(data)
        connection.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while connection.recv(1 << 16):
                pass
        due_s += 1.0 / RATE_HZ
        time.sleep(max(0.0, due_s - time.monotonic()))


def witness(port: int, seconds: float) -> None:
    """Receive, and say how long it was without a message at most."""
    pieces: list[tuple[int, bytes]] = []
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.recv(1 << 16)
        print("READY", flush=True)
        end_us = now_us() + round(seconds * 1e6)
        while now_us() < end_us:
            data = connection.recv(1 << 16)
            pieces.append((now_us(), data))
    print(json.dumps(judged(pieces)), flush=True)


def judged(pieces: Sequence[tuple[int, bytes]]) -> dict[str, Any]:
    """Longest gap and delay, and how many messages of the autopilot came."""
    framer = Framer()
    came_us, delays_us = [], []
    for at_us, data in pieces:
        for frame in framer.receive(data):
            if frame.sysid == SYSID and frame.msg_id == _SYSTEM_TIME:
                came_us.append(at_us)
                delays_us.append(at_us - int.from_bytes(frame.payload.ljust(12, b"\0")[:8], "little"))
    gaps_us = [later - earlier for earlier, later in itertools.pairwise(came_us)]
    return {
        "messages": len(came_us),
        "gap_ms": max(gaps_us) / 1e3,
        "delay_ms": max(delays_us) / 1e3,
    }


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
    """Connect a thousand times: some stay, most leave at once."""
    end_s, kept = time.monotonic() + seconds, []
    for number in range(CONNECTIONS):
        with contextlib.suppress(OSError):
            connection = socket.create_connection(("127.0.0.1", port), timeout=1.0)
            if number % 4:
                connection.close()
            else:
                kept.append(connection)
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


@contextlib.contextmanager
def process(*arguments: str, first: bool = False) -> Iterator[subprocess.Popen[str]]:
    """One of the processes, ended for sure; ``first``: before what else the machine does, if we may."""
    with subprocess.Popen([sys.executable, *arguments], stdout=subprocess.PIPE, text=True) as child:
        try:
            if first:
                with contextlib.suppress(PermissionError):
                    os.setpriority(os.PRIO_PROCESS, child.pid, FIRST_PRIORITY)
            yield child
        finally:
            child.kill()


def line_of(child: subprocess.Popen[str]) -> str:
    """The next line that it prints."""
    assert child.stdout is not None
    return child.stdout.readline().strip()


def resident_mb(pid: int) -> float:
    """Memory of a process, MB."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def measure(abuse: str, seconds: float) -> dict[str, Any]:
    """One abuse on a daemon of its own."""
    me = ("-m", "benchmarks.bench_aps_fairness")
    with process(*me, "--role", "autopilot", first=True) as source:
        arguments = ["-m", "aps", "--quiet", "--autopilot", f"tcp:127.0.0.1:{line_of(source)}"]
        with process(*arguments, "--sysid", str(SYSID), "--listen", "127.0.0.1:0", first=True) as daemon:
            port = line_of(daemon).split("listen=127.0.0.1:")[1].split()[0]
            with process(
                *me, "--role", "witness", "--port", port, "--seconds", str(seconds), first=True
            ) as watching:
                assert line_of(watching) == "READY"
                before_mb = resident_mb(daemon.pid)
                with process(*me, "--role", abuse, "--port", port, "--seconds", str(seconds)):
                    told: dict[str, Any] = json.loads(line_of(watching))
                    return {"abuse": abuse, **told, "growth_mb": resident_mb(daemon.pid) - before_mb}


def main(argv: Sequence[str] | None = None) -> None:
    """Measure each abuse, print lines for people and one line of JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--abuses", nargs="+", choices=ABUSES, default=list(ABUSES))
    parser.add_argument("--role", choices=["autopilot", "witness", *ABUSES], help=argparse.SUPPRESS)
    parser.add_argument("--port", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.role == "autopilot":
        with contextlib.suppress(OSError):
            autopilot()
    elif options.role == "witness":
        witness(options.port, options.seconds)
    elif options.role is not None:
        with contextlib.suppress(OSError):
            ABUSES[options.role](options.port, options.seconds)
    else:
        rows = [measure(abuse, options.seconds) for abuse in options.abuses]
        for row in rows:
            print(
                f"{row['abuse']:12} gap {row['gap_ms']:7.1f} ms (limit {LIMIT_GAP_MS:g}), "
                f"delay {row['delay_ms']:7.1f} ms, {row['messages']} messages, "
                f"memory {row['growth_mb']:+.1f} MB (limit {LIMIT_GROWTH_MB:g})"
            )
        print(json.dumps({"benchmark": "aps_fairness", "rows": rows}))


if __name__ == "__main__":
    main()
