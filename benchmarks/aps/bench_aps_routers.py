"""The daemon beside other routers: TCP in, three UDP out, 2000 messages a second, and fifty idle UA in one process.

CPU time per message of the daemon, of a bare asyncio relay that does not look at the bytes, and of MAVProxy (without
modules) and mavlink-routerd where they are on PATH, in turn in the same run; the time that a message takes through
each, by the kernel's time stamps; and the share of a core that one process with fifty UA needs at 50 messages a second
each. Where that is allowed, all run before whatever else the machine does.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import shutil
import socket
import statistics
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.wire.framer import Framer
from benchmarks.aps.aps_sources import before_others
from benchmarks.aps.aps_witness import Piece, piece_of, stamped
from benchmarks.aps.bench_aps import cpu_ns

SYSID: Final = 4
OUTPUTS: Final = 3
RATE_HZ: Final = 2000
IDLE_UA: Final = 50
IDLE_RATE_HZ: Final = 50
LIMIT_TO_MAVPROXY: Final = 0.2
LIMIT_TO_ROUTERD: Final = 2.0
LIMIT_P99_MS: Final = 1.0
LIMIT_CORES: Final = 0.5
SETTLE_S: Final = 4.0
_SYSTEM_TIME: Final = 2


RELAY: Final = """
import asyncio, socket, sys
outs = []
class In(asyncio.Protocol):
    def data_received(self, data):
        for out in outs: out.send(data)
async def main():
    for port in sys.argv[2:]:
        outs.append(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        outs[-1].connect(("127.0.0.1", int(port)))
    await asyncio.get_running_loop().create_connection(In, "127.0.0.1", int(sys.argv[1]))
    await asyncio.Event().wait()
asyncio.run(main())
"""


class Sink:
    """Receives, and notes when by the kernel's time stamps."""

    def __init__(self) -> None:
        self.pieces: list[Piece] = []
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        stamped(self.socket)
        asyncio.get_running_loop().add_reader(self.socket, self._came)

    @property
    def port(self) -> int:
        """Where it listens."""
        port: int = self.socket.getsockname()[1]
        return port

    def _came(self) -> None:
        self.pieces.append(piece_of(self.socket))

    def close(self) -> None:
        """Receive no more."""
        asyncio.get_running_loop().remove_reader(self.socket)
        self.socket.close()


def command_of(router: str, port: int, outputs: Sequence[int], folder: Path) -> list[str]:
    """How a router is started between a TCP server and UDP ports."""
    if router == "aps":
        command = [sys.executable, "-m", "aps", "--quiet", "--sysid", str(SYSID), "--listen", "127.0.0.1:0"]
        command += ["--autopilot", f"tcp:127.0.0.1:{port}"]
        return command + [word for output in outputs for word in ("--udp-out", f"127.0.0.1:{output}")]
    if router == "relay":
        return [sys.executable, "-c", RELAY, str(port), *map(str, outputs)]
    if router == "mavproxy.py":
        command = [
            router,
            "--daemon",
            "--non-interactive",
            "--default-modules",
            "",
            "--logfile",
            str(folder / "x.tlog"),
        ]
        command += ["--master", f"tcp:127.0.0.1:{port}"]
        return command + [word for output in outputs for word in ("--out", f"udp:127.0.0.1:{output}")]
    command = [router, "--tcp-port", "0", "--tcp-endpoint", f"127.0.0.1:{port}"]
    return command + [word for output in outputs for word in ("--endpoint", f"127.0.0.1:{output}")]


@contextlib.asynccontextmanager
async def started(command: Sequence[str]) -> AsyncIterator[int]:
    """A router; gives its process id."""
    process = await asyncio.create_subprocess_exec(
        *command, stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.DEVNULL
    )
    before_others(process.pid)
    try:
        yield process.pid
    finally:
        process.kill()
        await process.wait()


def message(mav: Any, number: int) -> bytes:
    """One of the stream: the time now, from which the delay follows; a heartbeat now and then."""
    mav.seq = number % 256
    if number % RATE_HZ == 0:
        return bytes(mavlink.MAVLink_heartbeat_message(2, 3, 0x59, 4, 4, 3).pack(mav))
    return bytes(mavlink.MAVLink_system_time_message(time.time_ns() // 1000, number).pack(mav))


async def feed(writer: asyncio.StreamWriter, rate_hz: int, seconds: float) -> int:
    """Send at a rate, each message by itself; returns how many."""
    mav = mavlink.MAVLink(None, srcSystem=SYSID, srcComponent=1)
    begin_s, sent, count = time.monotonic(), 0, round(rate_hz * seconds)
    while sent < count:
        due = min(count, round((time.monotonic() - begin_s) * rate_hz))
        while sent < due:
            writer.write(message(mav, sent))
            sent += 1
        await asyncio.sleep(0.0005)
    return sent


async def measure(router: str, seconds: float) -> dict[str, Any]:
    """One router: CPU per message, us, and delays."""
    loop = asyncio.get_running_loop()
    fed: asyncio.Future[asyncio.StreamWriter] = loop.create_future()
    server = await asyncio.start_server(lambda _, writer: fed.set_result(writer), "127.0.0.1", 0)
    sinks = [Sink() for _ in range(OUTPUTS)]
    ports = [sink.port for sink in sinks]
    try:
        with tempfile.TemporaryDirectory() as folder:
            command = command_of(router, server.sockets[0].getsockname()[1], ports, Path(folder))
            async with started(command) as pid:
                writer = await asyncio.wait_for(fed, 30)
                writer.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                await feed(writer, 50, SETTLE_S)  # it finds out who is there
                for sink in sinks:
                    sink.pieces.clear()
                begin_ns = cpu_ns(pid)
                sent = await feed(writer, RATE_HZ, seconds)
                await asyncio.sleep(0.2)
                spent_ns = cpu_ns(pid) - begin_ns
                writer.transport.abort()
    finally:
        server.close()
        for sink in sinks:
            sink.close()
        await asyncio.sleep(0.1)  # they are closed in the next turns
    delays_ms = [delay for sink in sinks for delay in delays_of(sink)]
    return {
        "router": router,
        "cpu_us": spent_ns / 1e3 / sent,
        "arrived": len(delays_ms) / (OUTPUTS * sent),
        "p50_ms": float(np.percentile(delays_ms, 50)),
        "p99_ms": float(np.percentile(delays_ms, 99)),
    }


def delays_of(sink: Sink) -> list[float]:
    """From sending to receiving, ms."""
    framer = Framer()
    return [
        (at_ns - 1000 * int.from_bytes(frame.payload.ljust(12, b"\0")[:8], "little")) / 1e6
        for at_ns, data in sink.pieces
        for frame in framer.receive(data)
        if frame.msg_id == _SYSTEM_TIME
    ]


async def idle_cores(seconds: float) -> float:
    """Share of a core of one process with fifty UA, each at fifty messages a second with one client."""
    writers: list[asyncio.StreamWriter] = []
    server = await asyncio.start_server(lambda _, writer: writers.append(writer), "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    sink = Sink()
    out = sink.port
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "daemons.yaml"
        daemon = {"autopilot": [f"tcp:127.0.0.1:{port}"], "sysid": SYSID, "tcp_server": [":0"]}
        daemon["udp_out"] = [f"127.0.0.1:{out}"]
        file.write_text(json.dumps({"daemons": [daemon] * IDLE_UA}))
        try:
            async with started([sys.executable, "-m", "aps", "--quiet", "--config", str(file)]) as pid:
                async with asyncio.timeout(60):
                    while len(writers) < IDLE_UA:  # noqa: ASYNC110
                        await asyncio.sleep(0.05)
                await asyncio.gather(*(feed(writer, IDLE_RATE_HZ, 2.0) for writer in writers))
                begin_ns, begin_s = cpu_ns(pid), time.monotonic()
                await asyncio.gather(*(feed(writer, IDLE_RATE_HZ, seconds) for writer in writers))
                return (cpu_ns(pid) - begin_ns) / 1e9 / (time.monotonic() - begin_s)
        finally:
            server.close()
            sink.close()
            for writer in writers:
                writer.transport.abort()
            await asyncio.sleep(0.1)  # they are closed in the next turns


def main(argv: Sequence[str] | None = None) -> None:
    """Measure, print lines for people and one line of JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args(argv)
    usual = os.sched_getscheduler(0)
    before_others(0)
    others = ["relay", *(router for router in ("mavproxy.py", "mavlink-routerd") if shutil.which(router))]
    rows = [
        asyncio.run(measure(router, options.seconds))
        for _ in range(options.rounds)
        for router in ("aps", *others)
    ]
    medians = {}
    for router in ("aps", *others):
        own = [row for row in rows if row["router"] == router]
        medians[router] = {
            key: statistics.median(row[key] for row in own) for key in own[0] if key != "router"
        }
        print(router, ", ".join(f"{key} {value:.3f}" for key, value in medians[router].items()))
    ratios = {router: medians["aps"]["cpu_us"] / medians[router]["cpu_us"] for router in others}
    limits = {
        "mavproxy.py": f" (limit {LIMIT_TO_MAVPROXY})",
        "mavlink-routerd": f" (limit {LIMIT_TO_ROUTERD})",
    }
    told = [f"{router} {ratio:.2f}{limits.get(router, '')}" for router, ratio in ratios.items()]
    print("cpu of aps to that of", ", ".join(told))
    print(f"p99 of aps {medians['aps']['p99_ms']:.2f} ms (limit {LIMIT_P99_MS:g})")
    cores = asyncio.run(idle_cores(options.seconds))
    os.sched_setscheduler(0, usual, os.sched_param(0))
    print(
        f"{IDLE_UA} UA at {IDLE_RATE_HZ} messages/s in one process: {cores:.2f} cores (limit {LIMIT_CORES})"
    )
    print(json.dumps({"benchmark": "aps_routers", "routers": medians, "ratios": ratios, "idle_cores": cores}))


if __name__ == "__main__":
    main()
