"""What the APS daemon costs per MAVLink message.

Framing: our framer, alone and with the state's decoding, against pymavlink's parse_buffer on the same recorded
ArduCopter bytes in alternated rounds; the median of the rounds' ratios is the figure.

Forwarding: CPU time of a daemon process per message, TCP in, n TCP clients out, at telemetry rates and in a
flood; and as a multiple of a bare asyncio relay, measured in the same run, that copies bytes to the same clients
without looking at them.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import platform
import socket
import statistics
import sys
import time
from collections.abc import AsyncIterator, Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.vehicle.telemetry import Telemetry
from aps.wire.framer import Framer

RECORDING = Path(__file__).parents[2] / "tests" / "data" / "mavlink_arducopter.bin"
SYSID = 4
CHUNK_BYTES = 1400
RATES_HZ = (200, 2000, 0)
"""Messages per second; 0 is a flood."""
TICK_S = 0.005
FLOOD_MESSAGES = 40_000
FLOOD_WINDOW = 1000
"""Messages under way in a flood: fewer than the daemon's queue holds, so that none is dropped."""
LIMIT_RATIO = 0.25
"""Our framing may cost at most this share of pymavlink's."""

RELAY = """
import asyncio, sys
clients = []
class Out(asyncio.Protocol):
    def connection_made(self, transport): clients.append(transport)
class In(asyncio.Protocol):
    def data_received(self, data):
        for client in clients: client.write(data)
async def main():
    loop = asyncio.get_running_loop()
    server = await loop.create_server(Out, "127.0.0.1", 0)
    await loop.create_connection(In, "127.0.0.1", int(sys.argv[1]))
    print(f"READY listen=127.0.0.1:{server.sockets[0].getsockname()[1]} ", flush=True)
    await asyncio.Event().wait()
asyncio.run(main())
"""


def chunks_of(data: bytes) -> list[bytes]:
    """The bytes as a TCP stream brings them."""
    return [data[at : at + CHUNK_BYTES] for at in range(0, len(data), CHUNK_BYTES)]


def timed_us(work: Callable[[], int]) -> float:
    """CPU time per message of one round, us."""
    begin_ns = time.process_time_ns()
    messages = work()
    return (time.process_time_ns() - begin_ns) / 1e3 / messages


def frame_only(chunks: Sequence[bytes]) -> int:
    """Our framer."""
    framer = Framer()
    return sum(len(framer.receive(chunk)) for chunk in chunks)


def frame_and_decode(chunks: Sequence[bytes]) -> int:
    """Our framer and the state."""
    framer, telemetry, count = Framer(), Telemetry(SYSID), 0
    for chunk in chunks:
        for frame in framer.receive(chunk):
            telemetry.update(frame, 0)
            count += 1
    return count


def pymavlink_parse(chunks: Sequence[bytes]) -> int:
    """pymavlink's parser, which decodes every message."""
    parser = mavlink.MAVLink(None)
    return sum(len(parser.parse_buffer(chunk) or ()) for chunk in chunks)


def framing(rounds: int) -> dict[str, float]:
    """Median costs and ratios."""
    chunks = chunks_of(RECORDING.read_bytes())
    timings: dict[str, list[float]] = {"framer": [], "framer_and_state": [], "pymavlink": []}
    for _ in range(rounds):
        timings["framer"].append(timed_us(lambda: sum(frame_only(chunks) for _ in range(3))))
        timings["pymavlink"].append(timed_us(lambda: pymavlink_parse(chunks)))
        timings["framer_and_state"].append(timed_us(lambda: sum(frame_and_decode(chunks) for _ in range(3))))
    ratios = {
        name: statistics.median(a / b for a, b in zip(timings[name], timings["pymavlink"], strict=True))
        for name in ("framer", "framer_and_state")
    }
    figures = {f"{name}_us": statistics.median(values) for name, values in timings.items()}
    return figures | {f"{name}_to_pymavlink": ratio for name, ratio in ratios.items()}


def cpu_ns(pid: int) -> int:
    """Time that a process has run on a CPU, ns."""
    return sum(int(path.read_text().split()[0]) for path in Path(f"/proc/{pid}/task").glob("*/schedstat"))


@contextlib.asynccontextmanager
async def forwarder(command: Sequence[str]) -> AsyncIterator[tuple[int, int]]:
    """Run a router process; gives its pid and the port of its clients."""
    process = await asyncio.create_subprocess_exec(sys.executable, *command, stdout=asyncio.subprocess.PIPE)
    assert process.stdout is not None
    try:
        ready = (await process.stdout.readline()).decode()
        yield process.pid, int(ready.split("listen=127.0.0.1:")[1].split()[0])
    finally:
        process.kill()
        await process.wait()


class Reader(asyncio.Protocol):
    """A client that reads and counts."""

    def __init__(self) -> None:
        self.seen_bytes = 0
        self.wanted_bytes = 0
        self.there = asyncio.Event()

    def data_received(self, data: bytes) -> None:
        self.seen_bytes += len(data)
        if self.seen_bytes >= self.wanted_bytes:
            self.there.set()

    async def until(self, wanted_bytes: int) -> None:
        """Wait until so many bytes have come in all."""
        self.wanted_bytes = wanted_bytes
        self.there.clear()
        if self.seen_bytes < wanted_bytes:
            async with asyncio.timeout(60):
                await self.there.wait()


@cache
def telemetry_stream(count: int) -> list[bytes]:
    """A busy autopilot's mix, with its clock going on."""
    mav = mavlink.MAVLink(None, srcSystem=SYSID, srcComponent=1)
    kinds: tuple[Callable[[int], Any], ...] = (
        lambda ms: mavlink.MAVLink_attitude_message(ms, 0.1, 0.2, 0.3, 0.1, 0.1, 0.1),
        lambda ms: mavlink.MAVLink_global_position_int_message(ms, 470000000, 80000000, 400, 40, 1, 2, 3, 4),
        lambda ms: mavlink.MAVLink_local_position_ned_message(ms, 1.0, 2.0, 3.0, 0.1, 0.2, 0.3),
        lambda _: mavlink.MAVLink_vfr_hud_message(10.0, 11.0, 90, 40, 400.0, 0.5),
        lambda ms: mavlink.MAVLink_raw_imu_message(ms, 1, 2, 3, 4, 5, 6, 7, 8, 9),
    )
    packed = []
    for number in range(count):
        packed.append(bytes(kinds[number % len(kinds)](1000 + number).pack(mav)))
        mav.seq = (mav.seq + 1) % 256
    return packed


async def forwarding_us(kind: str, clients: int, rate_hz: int, seconds: float) -> float:
    """CPU of the router per message, us. The feeder is the autopilot's side."""
    loop = asyncio.get_running_loop()
    fed: asyncio.Future[asyncio.StreamWriter] = loop.create_future()
    server = await asyncio.start_server(lambda _, writer: fed.set_result(writer), "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    command = ["-c", RELAY, str(port)]
    if kind == "aps":
        command = ["-m", "aps", "--quiet", "--autopilot", f"tcp:127.0.0.1:{port}"]
        command += ["--sysid", str(SYSID), "--listen", "127.0.0.1:0"]
    stream = telemetry_stream(round(rate_hz * seconds) if rate_hz else FLOOD_MESSAGES)
    try:
        async with forwarder(command) as (pid, listen_port):
            writer = await fed
            readers = [
                (await loop.create_connection(Reader, "127.0.0.1", listen_port))[1] for _ in range(clients)
            ]
            await asyncio.sleep(0.3)  # all clients are accepted
            begin_ns = cpu_ns(pid)
            await feed(writer, stream, rate_hz, readers)
            spent_ns = cpu_ns(pid) - begin_ns
            writer.close()
    finally:
        server.close()
    return spent_ns / 1e3 / len(stream)


async def feed(
    writer: asyncio.StreamWriter, stream: Sequence[bytes], rate_hz: int, readers: Sequence[Reader]
) -> None:
    """Send the messages: at a rate, or as fast as the clients get them."""
    connection: socket.socket = writer.get_extra_info("socket")
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    batch = max(1, round(rate_hz * TICK_S)) if rate_hz else FLOOD_WINDOW
    due_s, sent_bytes = time.perf_counter(), 0
    for at in range(0, len(stream), batch):
        data = b"".join(stream[at : at + batch])
        sent_bytes += len(data)
        writer.write(data)
        if rate_hz:
            due_s += TICK_S
            await asyncio.sleep(max(0.0, due_s - time.perf_counter()))
        else:
            await asyncio.gather(*(reader.until(sent_bytes) for reader in readers))
    await asyncio.gather(*(reader.until(sent_bytes) for reader in readers))


async def forwarding(clients: Sequence[int], seconds: float, rounds: int) -> list[dict[str, Any]]:
    """One row per rate and number of clients."""
    rows = []
    for rate_hz in RATES_HZ:
        for count in clients:
            costs: dict[str, list[float]] = {"aps": [], "relay": []}
            for _ in range(rounds):
                for kind, values in costs.items():
                    values.append(await forwarding_us(kind, count, rate_hz, seconds))
            ratio = statistics.median(a / b for a, b in zip(costs["aps"], costs["relay"], strict=True))
            rows.append(
                {
                    "rate_hz": rate_hz or "flood",
                    "clients": count,
                    "aps_us": round(statistics.median(costs["aps"]), 2),
                    "relay_us": round(statistics.median(costs["relay"]), 2),
                    "aps_to_relay": round(ratio, 2),
                }
            )
    return rows


def main(argv: Sequence[str] | None = None) -> None:
    """Measure, print lines for people and one line of JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=15, help="rounds of the framing measure")
    parser.add_argument("--seconds", type=float, default=1.5, help="length of a paced forwarding measure")
    parser.add_argument("--forwarding-rounds", type=int, default=3)
    parser.add_argument("--clients", type=int, nargs="+", default=[3])
    options = parser.parse_args(argv)
    framed = framing(options.rounds)
    print(
        f"framing: {framed['framer_us']:.2f} us/message, with the state {framed['framer_and_state_us']:.2f}, "
        f"pymavlink {framed['pymavlink_us']:.2f}: ratios {framed['framer_to_pymavlink']:.3f} and "
        f"{framed['framer_and_state_to_pymavlink']:.3f} (limit for the first {LIMIT_RATIO})"
    )
    rows = asyncio.run(forwarding(options.clients, options.seconds, options.forwarding_rounds))
    for row in rows:
        print(
            f"forwarding at {row['rate_hz']}{'' if row['rate_hz'] == 'flood' else ' messages/s'} to "
            f"{row['clients']}: {row['aps_us']} us CPU/message, bare relay {row['relay_us']}: "
            f"ratio {row['aps_to_relay']}"
        )
    result = {
        "benchmark": "aps",
        "python": platform.python_version(),
        "framing": {name: round(value, 4) for name, value in framed.items()},
        "framing_limit": LIMIT_RATIO,
        "forwarding": rows,
    }
    print(json.dumps(result))


if __name__ == "__main__":
    main()
