"""A router between an autopilot and four clients, on real sockets: what is said at one end, and what comes out where.

The endpoints are those of tests/unit/aps/hub/test_forwarding.py. After each frame a marker from the same endpoint goes
round: when it has come out everywhere else, so has what was sent before it.
"""

import asyncio
import contextlib
import itertools
import os
import shutil
import socket
from collections import Counter

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.daemon import Daemon, DaemonConfig
from tests.unit.aps.hub.test_forwarding import AP, SENDERS, bytes_of, heartbeat

CLIENTS = [name for name in SENDERS if name != AP]
MARKERS = itertools.count(1_000_000)
TIMEOUT_S = 10.0


def mavlink_routerd():
    """The real program, or the test is skipped."""
    path = os.environ.get("MAVLINK_ROUTERD") or shutil.which("mavlink-routerd")
    if path is None:
        pytest.skip("no mavlink-routerd: neither MAVLINK_ROUTERD nor PATH leads to one")
    return path


class Endpoint(asyncio.Protocol):
    """One end: keeps all frames that come, as pymavlink cuts them out."""

    def __init__(self):
        self.frames = []
        self.received = b""
        self.open = asyncio.Event()
        self._more = asyncio.Event()
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True

    def connection_made(self, transport):
        self.transport = transport
        transport.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.open.set()

    def data_received(self, data):
        self.received += data
        for message in self._parser.parse_buffer(data) or []:
            self.frames.append(bytes(message.get_msgbuf()))
        self._more.set()

    async def until(self, raw):
        async with asyncio.timeout(TIMEOUT_S):
            while raw not in self.frames:
                self._more.clear()
                await self._more.wait()


class RouterBench:
    """A router that runs, and its endpoints."""

    def __init__(self, ends, sysid):
        self.ends, self.sysid = ends, sysid

    async def introduce(self):
        """Everybody who speaks says a heartbeat; then nothing counts that was said before."""
        await self._until_all_are_heard()
        for name, senders in SENDERS.items():
            for sender in senders:
                await self.say(name, self.own(sender), bytes_of(heartbeat(), self.own(sender)))
        for end in self.ends.values():
            end.frames.clear()

    async def _until_all_are_heard(self):
        """A connection is there before the router has taken it: until it has, what it is sent is lost."""
        clients = [self.ends[name] for name in CLIENTS]
        async with asyncio.timeout(TIMEOUT_S):
            while not all(end.frames for end in clients):
                self.ends[AP].transport.write(
                    bytes_of(mavlink.MAVLink_system_time_message(1, next(MARKERS)), (self.sysid, 1))
                )
                await asyncio.sleep(0.02)

    def own(self, sender):
        """Ids of the UA's own system are 5 in the cases."""
        return (self.sysid, sender[1]) if sender[0] == 5 else sender

    async def say(self, name, speaker, *raws):
        """Send frames from an endpoint, and wait until they are wherever they go; ``speaker`` sends the marker."""
        marker = bytes_of(mavlink.MAVLink_system_time_message(1, next(MARKERS)), speaker)
        self.ends[name].transport.write(b"".join(raws) + marker)
        others = [end for other, end in self.ends.items() if other != name]
        await asyncio.gather(*(end.until(marker) for end in others))
        for end in others:
            end.frames.remove(marker)

    def came(self):
        """How often each frame has come, by endpoint."""
        return {name: Counter(end.frames) for name, end in self.ends.items()}


@contextlib.asynccontextmanager
async def bench_with(router, folder, sysid):
    """A bench with a daemon of ours (``"aps"``) or a mavlink-routerd (its path)."""
    loop = asyncio.get_running_loop()
    ends = {name: Endpoint() for name in SENDERS}
    server = await loop.create_server(lambda: ends[AP], "127.0.0.1", 0)
    autopilot_port = server.sockets[0].getsockname()[1]
    running = _daemon if router == "aps" else _routerd
    try:
        async with running(router, folder, autopilot_port, sysid) as port, asyncio.timeout(60):
            await ends[AP].open.wait()
            for name in CLIENTS:
                await _connect(ends[name], port)
            bench = RouterBench(ends, sysid)
            await bench.introduce()
            yield bench
    finally:
        server.close()
        for end in ends.values():
            if end.open.is_set():
                end.transport.abort()


async def _connect(end, port):
    while not end.open.is_set():
        try:
            await asyncio.get_running_loop().create_connection(lambda: end, "127.0.0.1", port)
        except ConnectionRefusedError:
            await asyncio.sleep(0.01)


@contextlib.asynccontextmanager
async def _daemon(_router, _folder, autopilot_port, sysid):
    config = DaemonConfig(autopilot=f"tcp:127.0.0.1:{autopilot_port}", sysid=sysid, stream_rates_hz={})
    async with Daemon(config) as daemon:
        yield daemon.listen_port


@contextlib.asynccontextmanager
async def _routerd(router, folder, autopilot_port, _sysid):
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    empty = folder / "routerd.conf"
    empty.write_text("[General]\n")  # else it reads that of the machine
    process = await asyncio.create_subprocess_exec(
        router,
        *("--conf-file", str(empty), "--conf-dir", str(folder / "none"), "--tcp-port", str(port)),
        *("--tcp-endpoint", f"127.0.0.1:{autopilot_port}"),
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.DEVNULL,
    )
    try:
        yield port
    finally:
        process.kill()
        await process.wait()
