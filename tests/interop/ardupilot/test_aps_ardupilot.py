"""The daemon with real ArduCopter and ArduPlane on SITL's built-in vehicles."""

import asyncio
import itertools
import math

import pytest

from aps.daemon import Daemon, DaemonConfig
from aps.vehicle.execution import Outcome
from aps.vehicle.flight.returning import PLANE_RADIUS_M
from tests.interop.builtin_vehicles import COPTER, PLANE, SYSID, sitl, until

pytestmark = pytest.mark.ardupilot


@pytest.fixture
async def copter(arducopter, tmp_path):
    async with (
        sitl(arducopter, "quad", COPTER, tmp_path, speedup=10) as port,
        Daemon(DaemonConfig(autopilot=f"tcp:127.0.0.1:{port}", sysid=SYSID)) as daemon,
    ):
        yield daemon


async def test_arducopter_state_streams_and_commands(copter):
    commands = copter.commands
    await asyncio.wait_for(copter.wait_heard(), 30)
    too_early = await commands.arm()
    assert too_early.outcome is Outcome.REFUSED
    assert "Arm: " in too_early.reason or "PreArm: " in too_early.reason
    assert (await commands.set_mode("GUIDED")).reached
    await until(copter, lambda state: state.ready_to_arm and state.position_ok)
    home = copter.state
    assert (home.lat_deg, home.lon_deg) == pytest.approx((-35.363262, 149.165237), abs=1e-5)
    assert home.alt_amsl_m == pytest.approx(584.0, abs=1.5)
    assert (home.landed_state, home.system_status, home.gps_fix_type) == ("on_ground", "STANDBY", 6)
    assert home.voltage_v == pytest.approx(12.6, abs=0.2)
    fence = {"FENCE_TYPE": 2.0, "FENCE_RADIUS": 100.0, "FENCE_ENABLE": 1.0}
    assert (await commands.run("parameters_set", fence)).reached  # it counts a second later
    on_ground = await commands.takeoff(20.0)
    assert on_ground.outcome is Outcome.REFUSED

    for result in (await commands.arm(), await commands.takeoff(20.0)):
        assert result.reached, result
    states = []
    subscription = copter.subscribe(states.append, rate_hz=10.0)
    result = await commands.run("goto_ned", 20.0, 0.0, -20.0, speed_mps=3.0)
    assert result.reached, result
    assert max(state.groundspeed_mps for state in states) == pytest.approx(3.0, abs=0.3)
    target_deg = home.lat_deg + math.degrees(60.0 / 6_378_137.0)
    result = await commands.goto(target_deg, home.lon_deg, 25.0, speed_mps=6.0)
    subscription.cancel()
    assert result.reached, result
    assert max(state.groundspeed_mps for state in states) == pytest.approx(6.0, abs=0.6)
    steps_ms = [after.time_boot_ms - before.time_boot_ms for before, after in itertools.pairwise(states)]
    assert sum(steps_ms) / len(steps_ms) == pytest.approx(100.0, abs=15.0)
    assert copter.state.position_ned_m[0] == pytest.approx(60.0, abs=3.0)
    result = await commands.run("goto_ned", 150.0, 0.0, -25.0)
    assert (result.outcome, result.reason.endswith("beyond its fence, and does not say so")) == (
        Outcome.REFUSED,
        True,
    )
    result = await commands.run("goto_ned", 50.0, 0.0, -25.0)
    assert result.reached, result
    by_waypoint_navigation = {"GUID_OPTIONS": 64.0}
    assert (await commands.run("parameters_set", by_waypoint_navigation)).reached
    result = await commands.run("goto_ned", 20.0, 10.0, -25.0, speed_mps=3.0)
    assert result.reached, result  # though it says that it flies to the point before
    assert (await commands.disarm()).outcome is Outcome.REFUSED
    result = await commands.rtl()
    assert result.reached, result
    assert math.hypot(*copter.state.position_ned_m[:2]) < 2.0
    counters = copter.hub.primary.framer.counters
    assert (counters.bad_crc, counters.bad_flags, counters.unknown_id) == (0, 0, 0)
    # what it prints between frames at boot, as far as we were there already: 41 bytes, then "Init Gyro**\n"
    assert counters.skipped_bytes <= 41 + len("Init Gyro**\n")
    assert copter.streams.refused == set()
    assert copter.streams.counters.accepted >= len(copter.config.stream_rates_hz)


@pytest.fixture
async def plane(arducopter, tmp_path):
    binary = arducopter.with_name("arduplane")
    if not binary.is_file():
        pytest.skip(f"no arduplane beside {arducopter}")
    async with (
        sitl(binary, "plane", PLANE, tmp_path, speedup=20) as port,
        Daemon(DaemonConfig(autopilot=f"tcp:127.0.0.1:{port}", sysid=SYSID)) as daemon,
    ):
        yield daemon


async def taken_off(plane):
    """Where it was."""
    commands = plane.commands
    await asyncio.wait_for(plane.wait_heard(), 30)
    assert (await commands.set_mode("FBWA")).reached
    await until(plane, lambda state: state.ready_to_arm and state.position_ok)
    home = plane.state
    for result in (await commands.arm(), await commands.takeoff(60.0)):
        assert result.reached, result
    return home


async def test_arduplane_takes_off_circles_and_returns(plane):
    commands, home = plane.commands, await taken_off(plane)
    target_deg = home.lat_deg + math.degrees(500.0 / 6_378_137.0)
    result = await commands.goto(target_deg, home.lon_deg, 90.0)
    assert result.reached, result
    assert plane.state.mode == "GUIDED"
    assert plane.state.alt_rel_m == pytest.approx(90.0, abs=16.0)
    assert plane.state.indicated_airspeed_mps > 10.0
    result = await commands.rtl()
    assert result.reached, result
    assert math.hypot(*plane.state.position_ned_m[:2]) < PLANE_RADIUS_M + 50.0
    await until(plane, lambda state: math.hypot(*state.position_ned_m[:2]) < 130.0)


async def test_arduplane_circles_to_the_left_and_a_point_after_a_wide_circle_as_it_is_set(plane):
    commands, home = plane.commands, await taken_off(plane)
    centre = (home.lat_deg, home.lon_deg, 90.0)
    result = await commands.run("orbit", *centre, radius_m=150.0, turns=0.7, clockwise=False)
    assert result.reached, result
    (north, east, _), velocity = plane.state.position_ned_m, plane.state.velocity_ned_mps
    assert north * velocity[1] - east * velocity[0] < 0.0
    assert math.hypot(north, east) == pytest.approx(150.0, abs=20.0)
    result = await commands.run("orbit", *centre, radius_m=350.0, turns=0.1)
    assert result.reached, result
    assert (await commands.goto(*centre)).reached
