"""Commands, missions and parameters on real ArduCopter and ArduPlane, SITL's built-in vehicles."""

import asyncio
import math

import pytest

from aps.daemon import Daemon, DaemonConfig
from aps.vehicle.execution import Outcome
from aps.vehicle.missions.items import MissionItem
from tests.interop.builtin_vehicles import COPTER, SYSID, sitl, until

pytestmark = [pytest.mark.ardupilot, pytest.mark.slow]

M_PER_DEG = math.radians(6_378_137.0)


@pytest.fixture
async def copter(arducopter, tmp_path):
    """A real ArduCopter at ten times real time, and its daemon."""
    async with (
        sitl(arducopter, "quad", COPTER, tmp_path, speedup=10) as port,
        Daemon(DaemonConfig(autopilot=f"tcp:127.0.0.1:{port}", sysid=SYSID)) as daemon,
    ):
        yield daemon


async def in_the_air(daemon, alt_rel_m=15.0):
    """Take off; returns the state on the ground."""
    await asyncio.wait_for(daemon.wait_heard(), 30)
    assert (await daemon.commands.set_mode("GUIDED")).reached
    await until(daemon, lambda state: state.ready_to_arm and state.position_ok)
    home = daemon.state
    for result in (await daemon.commands.arm(), await daemon.commands.takeoff(alt_rel_m)):
        assert result.reached, result
    return home


async def test_targets_of_every_kind(copter):
    home = await in_the_air(copter)
    run = copter.commands.run
    result = await run("goto_ned", 20.0, 10.0, -15.0, yaw_deg=90.0)
    assert result.reached, result
    assert math.dist(copter.state.position_ned_m, (20.0, 10.0, -15.0)) < 2.0
    result = await run("goto_ned", 10.0, 0.0, 0.0, frame="body", yaw_deg=0.0)
    assert result.reached, result
    # The nose pointed east: ahead is east.
    assert copter.state.position_ned_m[1] == pytest.approx(20.0, abs=3.0)

    older = asyncio.create_task(run("goto", home.lat_deg + 0.01, home.lon_deg, 20.0))
    states = []
    subscription = copter.subscribe(states.append, rate_hz=5.0)
    await asyncio.sleep(0.3)
    result = await run("velocity", 0.0, -4.0, -1.0, duration_s=15.0)
    subscription.cancel()
    assert result.reached, result
    assert (await older).outcome is Outcome.SUPERSEDED
    assert min(state.velocity_ned_mps[1] for state in states) == pytest.approx(-4.0, abs=0.4)
    assert min(state.velocity_ned_mps[2] for state in states) == pytest.approx(-1.0, abs=0.3)
    await until(copter, lambda state: math.hypot(*state.velocity_ned_mps) < 0.3)

    above_sea_m = home.alt_amsl_m + 25.0
    result = await run("goto", home.lat_deg, home.lon_deg, above_sea_m, frame="amsl", speed_mps=8.0)
    assert result.reached, result
    assert copter.state.alt_amsl_m == pytest.approx(above_sea_m, abs=1.5)
    refused = await copter.commands.run("reboot")
    assert refused.outcome is Outcome.REFUSED


async def test_a_takeoff_in_flight_leaves_a_landing_under_way(copter):
    await in_the_air(copter)
    landing = asyncio.create_task(copter.commands.land())
    await until(copter, lambda state: state.mode == "LAND" and state.landed_state == "landing")
    refused = await copter.commands.takeoff(40.0)
    assert str(refused) == "takeoff refused: it flies already"
    result = await landing
    assert result.reached, result
    assert copter.state.mode == "LAND"


async def test_orbit_stays_on_its_circle(copter):
    home = await in_the_air(copter)
    states = []
    copter.subscribe(states.append, rate_hz=5.0)
    result = await copter.commands.run(
        "orbit", home.lat_deg, home.lon_deg, 20.0, radius_m=25.0, speed_mps=5.0, turns=1.5
    )
    assert result.reached, result
    last = states[-100:]  # 20 s at 5 m/s: most of the last turn
    radii_m = [math.hypot(*state.position_ned_m[:2]) for state in last]
    assert max(radii_m) < 30.0
    assert min(radii_m) > 20.0
    assert all(state.groundspeed_mps == pytest.approx(5.0, abs=1.5) for state in last)
    # Clockwise from above: the bearing from the centre grows.
    north, east, _ = last[0].position_ned_m
    assert north * last[0].velocity_ned_mps[1] - east * last[0].velocity_ned_mps[0] > 0.0


async def test_follow_keeps_up_with_a_moving_target(copter):
    home = await in_the_air(copter)
    run = copter.commands.run
    target_m, speed_mps = 0.0, 5.0
    started_ms = copter.state.time_boot_ms
    result = None
    for _ in range(30):
        target_m = (copter.state.time_boot_ms - started_ms) * 1e-3 * speed_mps
        pending = asyncio.create_task(
            run("follow", home.lat_deg + target_m / M_PER_DEG, home.lon_deg, 15.0, speed_mps, duration_s=5.0)
        )
        await asyncio.sleep(0.1)
        if result is not None:
            assert (await result).outcome is Outcome.SUPERSEDED
        result = pending
    target_m = (copter.state.time_boot_ms - started_ms) * 1e-3 * speed_mps
    assert target_m > 100.0
    assert copter.state.position_ned_m[0] == pytest.approx(target_m, abs=15.0)
    result.cancel()


def square(home, count=4, alt_rel_m=20.0):
    """Waypoints around home."""
    items = [MissionItem(22, (0.0, 0.0, 0.0, 0.0, home.lat_deg, home.lon_deg, alt_rel_m))]
    for number in range(count):
        angle = math.tau * number / count
        lat = home.lat_deg + 30.0 * math.cos(angle) / M_PER_DEG
        lon = home.lon_deg + 30.0 * math.sin(angle) / M_PER_DEG / math.cos(math.radians(home.lat_deg))
        items.append(MissionItem(16, (0.0, 0.0, 0.0, 0.0, round(lat, 7), round(lon, 7), alt_rel_m)))
    return items


async def test_a_mission_is_flown_to_its_end(copter):
    run = copter.commands.run
    await asyncio.wait_for(copter.wait_heard(), 30)
    assert (await run("mode", "GUIDED")).reached
    await until(copter, lambda state: state.ready_to_arm and state.position_ok)
    items = [*square(copter.state), MissionItem(20, (0.0,) * 7)]
    result = await run("mission_upload", items)
    assert (result.reached, result.value) == (True, 6), result
    downloaded = await run("mission_download")
    assert downloaded.reached, downloaded
    kept = [MissionItem.from_json(item) for item in downloaded.value]
    assert [(item.command, item.params[4:]) for item in kept[:5]] == [
        (item.command, pytest.approx(item.params[4:], abs=2e-7)) for item in items[:5]
    ]
    result = await run("mission_set_current", 3)
    assert result.reached, result
    assert (await run("mission_set_current", 1)).reached
    assert (await run("arm")).reached
    seen = []
    result = await run("mission", on_progress=lambda progress: seen.append((progress.done, progress.total)))
    assert result.reached, result
    await until(copter, lambda state: state.mission_state == "COMPLETE")
    assert {done for done, _ in seen if done is not None} >= {1, 2, 3, 4, 5, 6}
    assert {total for _, total in seen if total is not None} == {6}
    assert (await run("mission_clear")).reached
    assert (await run("mission_download")).value == []
    assert (await run("mission_set_current", 40)).outcome is Outcome.REFUSED


async def test_200_items_fence_and_rally_up_and_down(copter):
    run = copter.commands.run
    await asyncio.wait_for(copter.wait_heard(), 30)
    await until(copter, lambda state: state.position_ok)
    items = square(copter.state, 199)
    assert (await run("mission_upload", items)).reached
    kept = [MissionItem.from_json(item) for item in (await run("mission_download")).value]
    assert [item.to_message(1, 0, 0).to_dict() for item in kept] == [
        item.to_message(1, 0, 0).to_dict() for item in items
    ]
    corners = [
        MissionItem(5001, (5.0, 0, 0, 0, *item.params[4:6], 0.0)) for item in square(copter.state, 5)[1:]
    ]
    assert (await run("mission_upload", corners, kind="fence")).reached
    kept = [MissionItem.from_json(item) for item in (await run("mission_download", kind="fence")).value]
    assert [(item.command, item.params[0], item.params[4:6]) for item in kept] == [
        (item.command, item.params[0], item.params[4:6]) for item in corners
    ]
    points = [MissionItem(5100, (0.0, 0, 0, 0, *item.params[4:])) for item in square(copter.state, 3)[1:]]
    assert (await run("mission_upload", points, kind="rally")).reached
    kept = [MissionItem.from_json(item) for item in (await run("mission_download", kind="rally")).value]
    assert [item.params[4:] for item in kept] == [item.params[4:] for item in points]
    assert (await run("mission_clear", kind="fence")).reached
    assert (await run("mission_download", kind="fence")).value == []
    assert len((await run("mission_download")).value) == 200


async def test_parameters_by_both_ways_are_the_same(copter):
    run = copter.commands.run
    await asyncio.wait_for(copter.wait_heard(), 30)
    await until(copter, lambda state: state.position_ok)  # calibrations are over
    told = []
    packed = await run("parameters", on_progress=told.append)
    assert packed.reached, packed
    assert len(packed.value) > 800
    assert not any("one by one" in progress.text for progress in told)
    one_by_one = await run("parameters", ftp=False)
    assert one_by_one.reached, one_by_one
    counters = {"STAT_RUNTIME", "STAT_BOOTCNT"}
    assert {k: v for k, v in packed.value.items() if k not in counters} == {
        k: v for k, v in one_by_one.value.items() if k not in counters
    }
    assert (await run("parameter_get", "rtl_loit_time")).value == packed.value["RTL_LOIT_TIME"]
    assert (await run("parameter_set", "RTL_LOIT_TIME", 2500)).reached
    assert (await run("parameter_get", "RTL_LOIT_TIME")).value == 2500
    result = await run("parameter_get", "NO_SUCH_THING")
    assert not result.reached
    assert (await run("parameters_set", {"RTL_LOIT_TIME": 1000, "WPNAV_RADIUS": 150.0})).value == 2


async def test_reboot_and_messages_on_demand(copter):
    run = copter.commands.run
    await asyncio.wait_for(copter.wait_heard(), 30)
    await until(copter, lambda state: state.time_boot_ms > 20_000)
    result = await run("message", "AUTOPILOT_VERSION")
    assert result.reached, result
    assert result.value["vendor_id"] >= 0
    assert copter.vehicle.messages.last("HEARTBEAT", 0).fields["autopilot"] == 3
    refused = await run("message", "ODOMETRY")
    assert refused.outcome is Outcome.REFUSED
    result = await asyncio.wait_for(run("reboot"), 60)
    assert result.reached, result
    assert copter.telemetry.reboots == 1
