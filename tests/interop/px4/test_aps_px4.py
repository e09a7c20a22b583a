"""The daemon with a real PX4 on its own simulation, and clients of others behind the daemon."""

import asyncio
import math
import re

import pytest
from pymavlink import mavutil

from aps.vehicle.execution import Outcome
from aps.vehicle.missions.items import MissionItem
from tests.interop.px4.px4_flight import away
from tests.interop.px4.px4_vehicle import copter_with_daemon
from tests.interop.served import CLIENTS, program

WITHOUT_PLACE = ("DO_CHANGE_SPEED", "NAV_RETURN_TO_LAUNCH")
pytestmark = [pytest.mark.px4, pytest.mark.slow, pytest.mark.timeout(300)]


@pytest.fixture
async def copter(tmp_path):
    """A daemon on a PX4 that is ready to arm."""
    async with copter_with_daemon(tmp_path) as daemon:
        yield daemon


async def test_px4_flies_by_every_verb(copter):
    commands, home, texts = copter.commands, copter.state, []
    copter.texts = texts.append
    too_early = await commands.takeoff(10.0)
    assert too_early.outcome is Outcome.REFUSED
    for result in (await commands.set_mode("GUIDED"), await commands.arm(), await commands.takeoff(10.0)):
        assert result.reached, result
    assert copter.state.mode.startswith("AUTO.")
    assert copter.state.alt_rel_m == pytest.approx(10.0, abs=1.0)
    items = [MissionItem.waypoint(*away(home, 20.0, 0.0), 12.0)]
    items += [MissionItem.from_json({"command": name, "params": [0] * 7}) for name in WITHOUT_PLACE]
    result = await commands.run("mission_upload", items)
    assert result.reached, result
    result = await commands.goto(*away(home, 20.0, 0.0), 12.0, yaw_deg=90.0)
    assert result.reached, result
    before = copter.state.position_ned_m
    result = await commands.run("velocity", 0.0, 2.0, duration_s=4.0)
    assert result.reached, result
    assert copter.state.position_ned_m[1] - before[1] > 3.0
    result = await commands.run("goto_ned", 0.0, 5.0, -12.0)
    assert result.reached, result
    for verb in ("hold", "rtl"):
        result = await commands.run(verb)
        assert result.reached, result
    assert math.hypot(*copter.state.position_ned_m[:2]) < 2.0
    assert "Takeoff detected" in [text.text for text in texts]
    assert copter.streams.refused == set()
    assert copter.hub.primary.framer.counters.bad_crc == 0


async def test_a_mission_that_ends_with_a_landing_is_done_on_the_ground(copter):
    commands, home = copter.commands, copter.state
    for result in (await commands.set_mode("GUIDED"), await commands.arm(), await commands.takeoff(6.0)):
        assert result.reached, result
    land = [0, 0, 0, None, *away(home, 8.0, 8.0), 0]
    items = [
        MissionItem.waypoint(*away(home, 8.0, 0.0), 6.0),
        MissionItem.from_json({"command": "NAV_LAND", "params": land}),
    ]
    assert (await commands.run("mission_upload", items)).reached
    result = await commands.run("mission")
    assert result.reached, result
    assert copter.state.landed_state == "on_ground"
    assert math.dist(copter.state.position_ned_m[:2], (8.0, 8.0)) < 2.0


async def test_pymavlink_reads_and_sets_parameters_of_both_kinds(copter):
    def client():
        link = mavutil.mavlink_connection(f"tcp:127.0.0.1:{copter.listen_port}", source_system=255)
        link.wait_heartbeat(timeout=20)
        found = {}
        for name in (b"SYS_AUTOSTART", b"MPC_XY_CRUISE"):
            link.mav.param_request_read_send(copter.config.sysid, 1, name, -1)
            while True:
                value = link.recv_match(type="PARAM_VALUE", blocking=True, timeout=10)
                if value.param_id == name.decode():
                    found[value.param_id] = value.get_msgbuf()[10:14]
                    break
        link.close()
        return found

    found = await asyncio.to_thread(client)
    assert int.from_bytes(found["SYS_AUTOSTART"], "little") == 10040, "the bytes have passed unchanged"
    ours = (await copter.commands.run("parameter_get", "SYS_AUTOSTART")).value
    assert ours == 10040


async def test_mavsdk_flies_px4_through_the_daemon(copter):
    read = ("--parameter", "MPC_XY_CRUISE")
    async with program(
        CLIENTS / "mavsdk_flight.py", f"tcpout://127.0.0.1:{copter.listen_port}", *read
    ) as client:
        lines = await client.ends_well(200.0)
    text = "\n".join(lines)
    assert "health: global position True home True" in text
    assert "offboard: 3 m/s east" in text
    assert not copter.state.armed


async def test_mavsdk_flies_a_mission_with_px4(copter):
    async with program(CLIENTS / "mavsdk_mission.py", f"tcpout://127.0.0.1:{copter.listen_port}") as client:
        lines = await client.ends_well(200.0)
    text = "\n".join(lines)
    assert "fence: 4 corners" in text
    assert "finished: True" in text


async def test_mavsdk_moves_files_and_fetches_a_log_of_px4(copter):
    for result in (await copter.commands.arm(), await copter.commands.run("disarm")):
        assert result.reached, result
    async with program(CLIENTS / "mavsdk_files.py", f"tcpout://127.0.0.1:{copter.listen_port}") as client:
        lines = await client.ends_well(200.0)
    text = "\n".join(lines)
    assert "there: noise.bin 5000 bytes" in text
    assert "the same there: True" in text
    assert "the same back: True" in text
    assert "cleared up" in text
    (got, whole, begins) = re.search(r"log \d+: (\d+) of (\d+) bytes, begins with (.*)", text).groups()
    assert got == whole
    assert begins == repr(b"ULog")
