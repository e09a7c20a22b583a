"""A scripted autopilot on a real TCP port, and real pymavlink clients."""

import asyncio
import contextlib
import socket

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

STEP_S = 0.01
"""Wall time per tick; each is 100 ms of the scripted autopilot's own clock."""
TICK_MS = 100


class ScriptedAutopilot:
    """Just enough of an ArduCopter: heartbeat, streams, acknowledgements, and motion by jumps.

    Its streams are those that SET_MESSAGE_INTERVAL asked for; a new boot forgets them.
    """

    def __init__(self, sysid=2):
        self.sysid = sysid
        self.kind = 3
        """MAV_AUTOPILOT."""
        self.mav = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=1)
        self.parser = mavlink.MAVLink(None)
        self.parser.robust_parsing = True
        self.refuse = {}
        """Command -> (MAV_RESULT, text)."""
        self.mute = set()
        """Commands that get no answer."""
        self.heard = []
        self.commands = []
        self.port = 0
        self.connections = 0
        self.reading = asyncio.Event()
        self.reading.set()
        self._server = self._writer = self._task = None
        self.boot()

    def boot(self):
        self.clock_ms, self.mode, self.armed, self.height_m = 1000, 0, False, 0.0
        self.lat, self.lon, self.goal_m = 470_000_000, 80_000_000, 0.0
        self.intervals_us = {}

    async def start(self):
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", self.port)
        self.port = self._server.sockets[0].getsockname()[1]

    async def stop(self):
        self._server.close()
        if self._writer is not None:
            self._writer.transport.abort()
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)

    async def _serve(self, reader, writer):
        self.connections += 1
        self._writer = writer
        self._task = asyncio.create_task(self._tick())
        with contextlib.suppress(ConnectionError):
            while data := await reader.read(4096):
                await self.reading.wait()
                for message in self.parser.parse_buffer(data) or []:
                    self.heard.append(message)
                    self._handle(message)
        self._task.cancel()
        writer.close()

    def send(self, message):
        self.send_raw(bytes(message.pack(self.mav)))

    def send_raw(self, data):
        if self._writer is not None and not self._writer.is_closing():
            self._writer.write(data)

    async def _tick(self):
        while True:
            self.step()
            await asyncio.sleep(STEP_S)

    def step(self):
        """Fly for TICK_MS and say what is to be said."""
        self.clock_ms += TICK_MS
        self.height_m += max(-2.0, min(2.0, self.goal_m - self.height_m))
        if self.mode in (6, 9) and self.height_m <= 0.0:
            self.armed = False
        if self.clock_ms % 1000 == 0:
            base = 0x59 | (0x80 if self.armed else 0)
            self.send(mavlink.MAVLink_heartbeat_message(2, self.kind, base, self.mode, 4, 3))
        for message in self._streams():
            if message.id in self.intervals_us:
                self.send(message)

    def _streams(self):
        prearm = mavlink.MAV_SYS_STATUS_PREARM_CHECK
        height_mm = round(self.height_m * 1000)
        landed = 2 if self.height_m > 0.1 else 1
        yield mavlink.MAVLink_attitude_message(self.clock_ms, 0.1, 0, 0, 0, 0, 0)
        yield mavlink.MAVLink_global_position_int_message(
            self.clock_ms, self.lat, self.lon, 400_000 + height_mm, height_mm, 0, 0, 0, 0
        )
        yield mavlink.MAVLink_sys_status_message(prearm, prearm, prearm, 0, 12000, 0, 90, 0, 0, 0, 0, 0, 0)
        yield mavlink.MAVLink_extended_sys_state_message(0, landed)

    def _handle(self, message):
        if message.get_type() not in ("COMMAND_LONG", "COMMAND_INT"):
            return
        self.commands.append(message)
        if message.command in self.mute:
            return
        result, text = self.refuse.get(message.command, (0, ""))
        if result:
            self.send(mavlink.MAVLink_statustext_message(2, text.encode()))
        else:
            self._obey(message)
        ack = mavlink.MAVLink_command_ack_message(
            message.command, result, 255, 0, message.get_srcSystem(), message.get_srcComponent()
        )
        self.send(ack)

    def _obey(self, message):
        match message.command:
            case 511:
                self.intervals_us[int(message.param1)] = int(message.param2)
            case 400:
                self.armed = bool(message.param1)
            case 176:
                self.mode = int(message.param2)
                if self.mode in (6, 9):
                    self.goal_m = 0.0
            case 22:
                self.goal_m = message.param7
            case 192:
                self.lat, self.lon, self.goal_m = message.x, message.y, message.z


class HeldAutopilot(ScriptedAutopilot):
    """The same on a plain socket: it runs for one tick when it is told to, as if physics held it in between."""

    def __init__(self, sysid=2):
        super().__init__(sysid)
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = self._server.getsockname()[1]
        self._connection = None
        self._said = b""
        self.streaming = True

    def accept(self):
        self._connection, _ = self._server.accept()
        self._connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._connection.setblocking(False)

    def send_raw(self, data):
        self._said += data

    def tick(self):
        """Read and obey, fly on, and have everything in the peer's socket buffer."""
        with contextlib.suppress(BlockingIOError):
            while data := self._connection.recv(65536):
                for message in self.parser.parse_buffer(data) or []:
                    self.heard.append(message)
                    self._handle(message)
        if self.streaming:
            self.step()
        said, self._said = self._said, b""
        self._connection.sendall(said)

    def hang_up(self):
        self._connection.close()

    def close(self):
        self._server.close()
        if self._connection is not None:
            self._connection.close()


class Client:
    """A pymavlink client: pymavlink encodes what it sends and parses what it gets."""

    def __init__(self, reader, writer, sysid, compid):
        self.reader, self.writer = reader, writer
        self.mav = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid)
        self.mav.robust_parsing = True
        self._waiting = []

    def send(self, message):
        self.writer.write(bytes(message.pack(self.mav)))

    async def next(self, kind, where=lambda message: True, timeout_s=10.0):
        """The next message of a type for which ``where`` holds."""
        async with asyncio.timeout(timeout_s):
            while True:
                while self._waiting:
                    message = self._waiting.pop(0)
                    if message.get_type() == kind and where(message):
                        return message
                data = await self.reader.read(65536)
                assert data, f"connection closed while waiting for {kind}"
                self._waiting = self.mav.parse_buffer(data) or []

    def close(self):
        self.writer.transport.abort()


class UdpPeer(asyncio.DatagramProtocol):
    """A pymavlink client with a UDP socket: it answers to whoever sent to it last."""

    def __init__(self, sysid=255, compid=190):
        self.mav = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid)
        self.mav.robust_parsing = True
        self.datagrams = 0
        self.to = None
        self._messages = asyncio.Queue()

    async def open(self, to=None):
        self.to = to
        loop = asyncio.get_running_loop()
        self._transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=("127.0.0.1", 0))
        self.port = self._transport.get_extra_info("sockname")[1]

    def datagram_received(self, data, addr):
        self.to, self.datagrams = addr, self.datagrams + 1
        for message in self.mav.parse_buffer(data) or []:
            self._messages.put_nowait(message)

    def send(self, message):
        self.send_raw(bytes(message.pack(self.mav)))

    def send_raw(self, data):
        self._transport.sendto(data, self.to)

    async def next(self, kind, where=lambda message: True, timeout_s=10.0):
        """The next message of a type for which ``where`` holds."""
        async with asyncio.timeout(timeout_s):
            while True:
                message = await self._messages.get()
                if message.get_type() == kind and where(message):
                    return message

    def close(self):
        self._transport.close()


@pytest.fixture
async def make_udp_peer():
    """Call for a peer with a UDP socket; ``to``: where it sends first."""
    peers = []

    async def make(to=None, **ids):
        peers.append(UdpPeer(**ids))
        await peers[-1].open(to)
        return peers[-1]

    yield make
    for peer in peers:
        peer.close()


@pytest.fixture
async def autopilot():
    autopilot = ScriptedAutopilot()
    await autopilot.start()
    yield autopilot
    await autopilot.stop()


@pytest.fixture
def make_held_autopilot():
    """Call for an autopilot that runs by ticks."""
    made = []

    def make():
        made.append(HeldAutopilot())
        return made[-1]

    yield make
    for autopilot in made:
        autopilot.close()


@pytest.fixture
async def connect():
    """Call with a port: a pymavlink client connected to it."""
    clients = []

    async def connect(port, sysid=255, compid=190):
        client = Client(*await asyncio.open_connection("127.0.0.1", port), sysid, compid)
        clients.append(client)
        return client

    yield connect
    for client in clients:
        client.close()


@pytest.fixture
async def eventually():
    """Wait for a condition on local objects, with a time limit."""

    async def eventually(condition, timeout_s=10.0):
        async with asyncio.timeout(timeout_s):
            while not condition():  # noqa: ASYNC110 (any condition on plain objects; nobody sets an event)
                await asyncio.sleep(0.005)

    return eventually
