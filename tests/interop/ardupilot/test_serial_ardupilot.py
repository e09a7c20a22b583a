"""Real ArduCopter as on a vehicle: behind a serial line, with its own fail-safes, with signed links."""

import asyncio
import contextlib
import hashlib
import os
import time
import tty

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.daemon import Daemon, DaemonConfig
from aps.wire.framer import Framer
from tests.interop.builtin_vehicles import COPTER, SYSID, sitl, until

pytestmark = [pytest.mark.ardupilot, pytest.mark.slow]

GCS_FAILSAFE = "FS_GCS_ENABLE 1\nFS_GCS_TIMEOUT 5\n"
GCS, DAEMON = (255, 190), (SYSID, 191)
SIGNING_EPOCH_S = 1_420_070_400
"""2015-01-01, from where MAVLink counts the time of signatures, in 10 us."""


@contextlib.contextmanager
def serial_line():
    """Two pseudo-terminals, joined: gives the names of both ends."""
    loop = asyncio.get_running_loop()
    ends = [os.openpty() for _ in range(2)]
    for pair in ends:
        for end in pair:
            tty.setraw(end)
        os.set_blocking(pair[0], False)
    (one, _), (other, _) = ends

    def pump(source, to):
        with contextlib.suppress(BlockingIOError):
            os.write(to, os.read(source, 4096))

    loop.add_reader(one, pump, one, other)
    loop.add_reader(other, pump, other, one)
    try:
        yield tuple(os.ttyname(end) for _, end in ends)
    finally:
        for pair in ends:
            loop.remove_reader(pair[0])
            for end in pair:
                os.close(end)


class Station:
    """A ground station on the daemon's TCP port."""

    def __init__(self, writer):
        self.writer = writer
        self.mav = mavlink.MAVLink(None, *GCS)

    def say(self, message):
        self.writer.write(bytes(message.pack(self.mav)))

    async def beat(self):
        while True:
            self.say(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
            await asyncio.sleep(0.05)


async def airborne(daemon):
    """Take off."""
    await asyncio.wait_for(daemon.wait_heard(), 30)
    assert (await daemon.commands.set_mode("GUIDED")).reached
    await until(daemon, lambda state: state.ready_to_arm and state.position_ok)
    for result in (await daemon.commands.arm(), await daemon.commands.takeoff(10.0)):
        assert result.reached, result


async def passes(daemon, duration_ms):
    """Wait in the autopilot's time."""
    end_ms = daemon.state.time_boot_ms + duration_ms
    await until(daemon, lambda state: state.time_boot_ms > end_ms)


@pytest.fixture
async def vehicle(arducopter, tmp_path):
    """A daemon on a serial line, what it said to the vehicle unasked, and the port of the vehicle's serial1."""
    said = []

    def tap(raw, link):
        said.extend(frame for frame in Framer(trusting=True).receive(raw) if frame.sysid == SYSID)

    with serial_line() as (theirs, ours):
        parameters, config = (
            COPTER + GCS_FAILSAFE,
            DaemonConfig(autopilot=f"serial:{ours}:57600", sysid=SYSID),
        )
        async with (
            sitl(arducopter, "quad", parameters, tmp_path, 5, f"uart:{theirs}:57600") as port,
            Daemon(config) as daemon,
        ):
            daemon.hub.taps.append(tap)
            yield daemon, said, port + 2


async def test_a_vehicle_on_a_serial_line_keeps_its_failsafes(vehicle):
    daemon, said, _ = vehicle
    await asyncio.wait_for(daemon.wait_heard(), 30)
    await until(daemon, lambda state: state.gps_fix_type >= 3)
    ours = {(frame.msg_id, frame.payload[28:30]) for frame in said if frame.compid == 191}
    unasked = {msg_id for msg_id, _ in ours}
    commands = {int.from_bytes(command, "little") for msg_id, command in ours if msg_id == 76}
    assert (unasked, commands) == ({0, 76, 111}, {511})  # heartbeats, stream rates, TIMESYNC: nothing else
    assert daemon.state.armed is False

    await airborne(daemon)
    _, writer = await asyncio.open_connection("127.0.0.1", daemon.listen_port)
    beating = asyncio.create_task(Station(writer).beat())
    await passes(daemon, 8000)
    assert daemon.state.mode == "GUIDED"
    beating.cancel()
    writer.close()
    left_ms = daemon.state.time_boot_ms
    await until(daemon, lambda state: state.mode == "RTL")  # although the daemon's heartbeats go on
    assert 4000 <= daemon.state.time_boot_ms - left_ms < 9000
    latency = daemon.statistics()["autopilot_links"][0]["latency"]
    assert latency["answered"] > 5
    assert 0.0 < latency["least_ms"] <= latency["median_ms"] < 100.0


async def test_without_the_daemon_the_ground_stations_behind_it_are_lost(arducopter, tmp_path):
    async with sitl(arducopter, "quad", COPTER + GCS_FAILSAFE, tmp_path, 5) as port:
        config = DaemonConfig(autopilot=f"tcp:127.0.0.1:{port}", sysid=SYSID)
        async with Daemon(config) as daemon:
            await airborne(daemon)
            _, writer = await asyncio.open_connection("127.0.0.1", daemon.listen_port)
            beating = asyncio.create_task(Station(writer).beat())
            await passes(daemon, 8000)
            assert daemon.state.mode == "GUIDED"
            beating.cancel()
            stopped_ms = daemon.state.time_boot_ms
        writer.close()
        async with Daemon(config) as later:
            await until(later, lambda state: state.time_boot_ms > stopped_ms + 7000)
            assert later.state.mode == "RTL"


async def test_an_autopilot_that_wants_signatures_is_flown_with_its_key_only(vehicle, tmp_path):
    serial, _, port = vehicle
    await asyncio.wait_for(serial.wait_heard(), 30)
    (tmp_path / "key").write_text("correct horse battery staple\n")
    key = hashlib.sha256(b"correct horse battery staple").digest()
    _, writer = await asyncio.open_connection("127.0.0.1", serial.listen_port)
    stamp = int((time.time() - SIGNING_EPOCH_S) * 1e5)  # noqa: TID251
    Station(writer).say(mavlink.MAVLink_setup_signing_message(SYSID, 1, list(key), stamp))
    address = f"tcp:127.0.0.1:{port}"
    async with Daemon(DaemonConfig(autopilot=f"{address},key={tmp_path / 'key'}", sysid=SYSID)) as signed:
        await asyncio.wait_for(signed.wait_heard(), 30)
        result = await signed.commands.set_mode("GUIDED")
        assert result.reached, result
        signing = signed.statistics()["autopilot_links"][0]["signing"]
        assert signing["verified"] > 0
        assert signing["bad"] == 0
    async with Daemon(DaemonConfig(autopilot=address, sysid=SYSID)) as unsigned:
        await asyncio.wait_for(unsigned.wait_heard(), 30)
        result = await unsigned.commands.set_mode("STABILIZE")
        assert str(result) == "mode timed out: no acknowledgement after 5 tries"
    writer.close()
