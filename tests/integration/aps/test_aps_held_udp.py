"""The held daemon and an autopilot that speaks by UDP, as PX4 does: on loopback what is sent is there at once."""

import contextlib
import select
import socket
import subprocess
import sys
import threading

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.config import DaemonConfig
from aps.held import HeldDaemon
from aps.links.address import parse_autopilot
from aps.links.kinds.held_udp import HeldUdpLink, datagrams_of

TICK_NS = 50_000_000
SYSID = 3


class Px4ByUdp:
    """Sends to the daemon's port from one of its own."""

    def __init__(self, port):
        self.mav = mavlink.MAVLink(None, srcSystem=SYSID, srcComponent=1)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.daemon = ("127.0.0.1", port)

    def say(self, *messages):
        self.socket.sendto(b"".join(bytes(message.pack(self.mav)) for message in messages), self.daemon)

    def heartbeat(self, armed=False):
        base = 0x1D | (0x80 if armed else 0)
        self.say(mavlink.MAVLink_heartbeat_message(2, 12, base, 4 << 16 | 3 << 24, 3, 3))

    def hear(self):
        parser, heard = mavlink.MAVLink(None), []
        with contextlib.suppress(BlockingIOError):
            while True:
                heard += parser.parse_buffer(self.socket.recv(65536)) or []
        return heard


@pytest.fixture
async def held():
    """A held daemon, connected, and its autopilot."""
    async with HeldDaemon(DaemonConfig(autopilot="udp-in:127.0.0.1:0", sysid=SYSID)) as daemon:
        await daemon.connect()
        autopilot = Px4ByUdp(daemon.link.port)
        with autopilot.socket:
            yield daemon, autopilot


def exchange(daemon, tick, decide=lambda: None):
    daemon.begin_exchange(tick * TICK_NS)
    decide()
    daemon.end_exchange()


async def test_what_was_sent_before_an_exchange_is_heard_in_it(held):
    daemon, autopilot = held
    exchange(daemon, 1)
    assert autopilot.hear() == [], "whom to speak to is not known yet"
    autopilot.heartbeat()
    assert daemon.state.mode == ""
    exchange(daemon, 2)
    assert daemon.state.mode == "AUTO.LOITER"
    assert "HEARTBEAT" in [message.get_type() for message in autopilot.hear()]
    done = []
    exchange(daemon, 3, lambda: daemon.commands.start("arm", on_done=done.append))
    (checks,) = [message for message in autopilot.hear() if getattr(message, "command", 0) == 401]
    assert checks.get_srcComponent() == 191
    autopilot.say(mavlink.MAVLink_command_ack_message(401, 0, 0, 0, SYSID, 191))
    exchange(daemon, 4)
    assert [m.command for m in autopilot.hear() if m.get_type() == "COMMAND_LONG" and m.command < 500] == [
        400
    ]
    autopilot.say(mavlink.MAVLink_command_ack_message(400, 0, 0, 0, SYSID, 191))
    autopilot.heartbeat(armed=True)
    exchange(daemon, 5)
    assert [str(result) for result in done] == ["arm reached"]


async def test_times_of_the_machine_and_chance_in_answers_of_px4_are_told_once(held):
    """Its own TIMESYNC requests come in each run, and say nothing that does not repeat."""
    daemon, autopilot = held
    reasons = []
    daemon.on_wall_time = reasons.append
    asks, answers = mavlink.MAVLink_timesync_message(0, 132), mavlink.MAVLink_timesync_message(1 << 40, 7)
    time = mavlink.MAVLink_system_time_message(1_795_750_890_000_000, 50)
    autopilot.heartbeat()
    exchange(daemon, 0)
    for tick, (said, told) in enumerate(
        [(asks, []), (time, ["SYSTEM_TIME"]), (answers, ["SYSTEM_TIME", "TIMESYNC"])], start=1
    ):
        autopilot.say(said)
        autopilot.say(said)
        exchange(daemon, tick)
        assert [word for word, reason in zip(told, reasons, strict=True) if word in reason] == told


async def test_only_the_autopilot_is_heard(held):
    daemon, autopilot = held
    autopilot.heartbeat()
    exchange(daemon, 1)
    stranger = Px4ByUdp(daemon.link.port)
    with stranger.socket:
        stranger.heartbeat(armed=True)
        exchange(daemon, 2)
        assert not daemon.state.armed
        readable, _, _ = select.select([daemon.link._socket], [], [], 0)
        assert readable == [], "the kernel keeps it away"


async def test_where_the_autopilots_port_is_known_nobody_else_can_take_its_place():
    autopilot = Px4ByUdp(0)
    config = DaemonConfig(autopilot="udp-in:127.0.0.1:0", sysid=SYSID)
    with autopilot.socket:
        async with HeldDaemon(config, peer=autopilot.socket.getsockname()) as daemon:
            await daemon.connect()
            stranger = Px4ByUdp(daemon.link.port)
            with stranger.socket:
                stranger.heartbeat(armed=True)
                exchange(daemon, 1)
            assert daemon.state.mode == ""
            autopilot.daemon = ("127.0.0.1", daemon.link.port)
            exchange(daemon, 30)
            assert autopilot.hear() == [], "it has not spoken yet"
            autopilot.heartbeat()
            exchange(daemon, 31)
            assert daemon.state.mode == "AUTO.LOITER"
            assert not daemon.state.armed
            assert autopilot.hear() != []


async def test_an_autopilot_that_begins_anew_from_another_port_is_heard(held):
    daemon, autopilot = held
    autopilot.heartbeat()
    exchange(daemon, 1)
    autopilot.socket.close()
    exchange(daemon, 30)  # what the daemon says is refused: nobody listens there
    exchange(daemon, 60)
    again = Px4ByUdp(daemon.link.port)
    with again.socket:
        again.heartbeat(armed=True)
        exchange(daemon, 61)
        assert daemon.state.armed
        exchange(daemon, 90)
        assert "HEARTBEAT" in [message.get_type() for message in again.hear()]


FLOOD = """
import socket, sys
sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
while True:
    sender.sendto(b"x", ("127.0.0.1", int(sys.argv[1])))
"""


@pytest.mark.slow
def test_whoever_goes_on_sending_does_not_hold_the_exchange():
    link = HeldUdpLink(parse_autopilot("udp-in:127.0.0.1:0"), 1 << 20)
    assert link.connect_now()
    command = [sys.executable, "-I", "-c", FLOOD, str(link.port)]
    floods = [subprocess.Popen(command) for _ in range(3)]
    try:
        for _ in range(20):  # they send as fast as is read, or faster
            readable, _, _ = select.select([link._socket], [], [], 20.0)
            assert readable
            reading = threading.Thread(target=link.read, daemon=True)
            reading.start()
            reading.join(20.0)
            assert not reading.is_alive()
    finally:
        for flood in floods:
            flood.kill()
            flood.wait()
        link.close()


async def test_a_datagram_that_cannot_be_sent_is_a_link_lost(held):
    daemon, autopilot = held
    autopilot.heartbeat()
    exchange(daemon, 1)
    downs = []
    daemon.on_link_down = lambda: downs.append(daemon.link_up)
    assert daemon.link.write(bytes(70_000)), "longer than a datagram: EMSGSIZE"
    exchange(daemon, 2)
    assert (downs, daemon.counters.link_losses) == ([False], 1)
    await daemon.connect()
    exchange(daemon, 3)
    assert daemon.link_up


async def test_datagrams_that_the_kernel_drops_are_told(held):
    daemon, autopilot = held
    reasons = []
    daemon.on_wall_time = reasons.append
    autopilot.heartbeat()
    exchange(daemon, 1)
    room = daemon.link.receive_buffer_bytes
    sent = room // 1024 + 100
    for _ in range(sent):
        autopilot.socket.sendto(bytes(1024), autopilot.daemon)
    exchange(daemon, 2)
    kept = daemon.counters.read_bytes // 1024
    autopilot.heartbeat()
    exchange(daemon, 3)
    lost = daemon.counters.lost_datagrams
    assert lost == sent - kept > 0
    assert reasons[-1] == f"{lost} datagrams of the autopilot were lost: the kernel had no room for them"


async def test_a_port_that_is_taken_is_told():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        async with HeldDaemon(DaemonConfig(autopilot=f"udp-in:127.0.0.1:{port}", sysid=SYSID)) as daemon:
            with pytest.raises(OSError, match=f"{port}"):
                await daemon.connect()


def test_frames_go_whole_into_datagrams():
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    texts = [mavlink.MAVLink_statustext_message(6, b"x" * (n % 50 + 1)) for n in range(200)]
    frames = [bytes(text.pack(mav, force_mavlink1=n % 3 == 0)) for n, text in enumerate(texts)]
    datagrams = list(datagrams_of(b"".join(frames)))
    assert b"".join(datagrams) == b"".join(frames)
    assert len(datagrams) < 12
    assert max(map(len, datagrams)) <= 1400
    boundaries = {sum(map(len, frames[:n])) for n in range(len(frames) + 1)}
    assert {sum(map(len, datagrams[:n])) for n in range(len(datagrams) + 1)} <= boundaries
    assert list(datagrams_of(b"garbage")) == [b"garbage"]
