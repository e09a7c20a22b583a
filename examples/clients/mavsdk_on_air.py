"""A whole flight with MAVSDK over a slow radio (pip install mavsdk): parameters, a mission up and down, GUIDED, home.

    python mavsdk_on_air.py tcpout://127.0.0.1:5790

MAVSDK gives an answer up after half a second or so, three times. Over telemetry modems it takes as long, and now and
then it is lost: what fails is asked for again here.
"""

import argparse
import asyncio
import math
import sys

from mavsdk import ComponentType, Configuration, MavsdkError
from mavsdk.asyncio import Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.mission_raw import MissionItem

DEG_PER_M = 1 / 111_320
HOME, WAYPOINT, TAKEOFF = 0, 16, 22
ABOVE_SEA, ABOVE_HOME = 0, 6
TIMES = 20


def say(*words):
    sys.stdout.write(" ".join(map(str, words)) + "\n")  # at once: MAVSDK logs there from threads of its own
    sys.stdout.flush()


async def first(values, condition=lambda _: True):
    """Wait for a value for which the condition holds."""
    async for value in values:
        if condition(value):
            return value
    raise RuntimeError("MAVSDK has no more to say")


async def again(ask, *arguments):
    """Ask until it succeeds."""
    for _ in range(TIMES):
        try:
            return await ask(*arguments)
        except MavsdkError as error:
            say("again:", str(error).partition(";")[0])
            await asyncio.sleep(1)
    raise RuntimeError(f"{ask.__name__} failed {TIMES} times")


async def ask_for_streams(telemetry):
    """ArduPilot sends to a telemetry port what it is asked for, and heartbeats; a slow link has room for few."""
    await again(telemetry.set_rate_health, 1.0)
    await again(telemetry.set_rate_home, 0.5)
    await again(telemetry.set_rate_position, 2.0)


async def reach(action, telemetry, mode):
    """Ask for a flight mode until it is told."""
    for _ in range(TIMES):
        await again(action)
        try:
            await asyncio.wait_for(first(telemetry.subscribe_flight_mode(), lambda m: m.name == mode), 5)
        except TimeoutError:
            continue
        say("mode:", mode)
        return
    raise RuntimeError(f"no mode {mode}")


def items_around(home, count):
    """Home, a take-off and waypoints on a circle, as ArduPilot numbers them."""
    places = [
        (WAYPOINT, ABOVE_SEA, 0.0, 0.0, home.absolute_altitude_m),
        (TAKEOFF, ABOVE_HOME, 0.0, 0.0, 15.0),
    ]
    for number in range(2, count):
        angle = 2 * math.pi * number / count
        places.append((WAYPOINT, ABOVE_HOME, 40 * math.cos(angle), 40 * math.sin(angle), 15.0 + number))
    east = math.cos(math.radians(home.latitude_deg))
    return [
        MissionItem(
            *(seq, frame, command, int(seq == 0), 1, 0.0, 0.0, 0.0, 0.0),
            round((home.latitude_deg + north_m * DEG_PER_M) * 1e7),
            round((home.longitude_deg + east_m * DEG_PER_M / east) * 1e7),
            *(height_m, 0),
        )
        for seq, (command, frame, north_m, east_m, height_m) in enumerate(places)
    ]


def where(item):
    return item.command, item.x, item.y, round(item.z, 2)


async def keep_mission(plan, home, count):
    """Upload, and read back what the autopilot has then; it knows home better."""
    items = items_around(home, count)
    await again(plan.upload_mission, items)
    kept = await again(plan.download_mission)
    same = [where(item) for item in kept[1:]] == [where(item) for item in items[1:]]
    say(f"mission: {len(items)} up, {len(kept)} down, the same: {same}")


async def fly(telemetry, action):
    """Arm, take off in GUIDED, fly to a point, hold, return."""
    await again(action.set_takeoff_altitude, 10.0)
    await again(action.arm)
    say("armed:", await first(telemetry.subscribe_armed(), bool))
    await again(action.takeoff)
    position = await first(telemetry.subscribe_position(), lambda p: p.relative_altitude_m > 9.0)
    say(f"height: {position.relative_altitude_m:.0f} m")
    goal_deg = position.latitude_deg + 30 * DEG_PER_M
    place = goal_deg, position.longitude_deg, position.absolute_altitude_m, math.nan
    await again(action.goto_location, *place)
    there = await first(
        telemetry.subscribe_position(), lambda p: abs(p.latitude_deg - goal_deg) < 2 * DEG_PER_M
    )
    say(f"north: {(there.latitude_deg - position.latitude_deg) / DEG_PER_M:.0f} m")
    await reach(action.hold, telemetry, "HOLD")
    await reach(action.return_to_launch, telemetry, "RETURN_TO_LAUNCH")


async def main(url, count):
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with Mavsdk(configuration) as mavsdk:
        await mavsdk.add_any_connection(url)
        system = await mavsdk.first_autopilot(timeout_s=120)
        say("system:", await system.get_system_id())
        telemetry = TelemetryAsync(system)
        everything = await again(ParamAsync(system).get_all_params)
        say("parameters:", len(everything.int_params) + len(everything.float_params))
        await ask_for_streams(telemetry)
        await first(telemetry.subscribe_health(), lambda health: health.is_armable)
        await keep_mission(MissionRawAsync(system), await first(telemetry.subscribe_home()), count)
        await fly(telemetry, ActionAsync(system))


parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("url", nargs="?", default="tcpout://127.0.0.1:5790")
parser.add_argument("--items", type=int, default=20)
arguments = parser.parse_args()
asyncio.run(main(arguments.url, arguments.items))
