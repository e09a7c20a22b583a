"""Fly a mission within a fence with MAVSDK (pip install mavsdk): upload, start, pause, go on, to the end.

    python mavsdk_mission.py tcpout://127.0.0.1:6760

With ArduPilot, MAVSDK's plugin `mission` knows waypoints only (its take-off and its return are refused, and it cannot
read ArduPilot's mission), so the vehicle takes off first. With --raw, take-off and return are items of the mission,
by the plugin `mission_raw`; a --fixed-wing takes off like that.
"""

import argparse
import asyncio
import math
import sys

from mavsdk import ComponentType, Configuration
from mavsdk.asyncio import Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.geofence import GeofenceAsync
from mavsdk.asyncio.plugins.mission import MissionAsync
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins import mission, mission_raw
from mavsdk.plugins.geofence import FenceType, GeofenceData, Point, Polygon

DEG_PER_M = 1 / 111_320
PLACES = [(1, 0), (1, 1), (0, 1)]
WAYPOINT, RETURN, TAKEOFF = 16, 20, 22  # MAV_CMD_NAV_...
ABOVE_SEA, ABOVE_HOME = 0, 6  # MAV_FRAME_GLOBAL, MAV_FRAME_GLOBAL_RELATIVE_ALT_INT


def say(*words):
    sys.stdout.write(
        " ".join(map(str, words)) + "\n"
    )  # at once, as MAVSDK logs there from threads of its own
    sys.stdout.flush()


async def first(values, condition=lambda _: True):
    """Wait for a value for which the condition holds."""
    async for value in values:
        if condition(value):
            return value
    raise RuntimeError("MAVSDK has no more to say")


def around(home, north_m, east_m):
    east_deg_per_m = DEG_PER_M / math.cos(math.radians(home.latitude_deg))
    return home.latitude_deg + north_m * DEG_PER_M, home.longitude_deg + east_m * east_deg_per_m


def fence(home, size_m):
    corners = [(-1, -1), (-1, 1), (1, 1), (1, -1)]
    points = [Point(*around(home, size_m * north, size_m * east)) for north, east in corners]
    return GeofenceData(polygons=[Polygon(points, FenceType.INCLUSION)])


def waypoints(home, size_m, height_m):
    return mission.MissionPlan(
        [
            mission.MissionItem(*around(home, size_m * north, size_m * east), height_m, is_fly_through=True)
            for north, east in PLACES
        ]
    )


def raw_items(home, size_m, height_m, returns):
    """Item 0 is home, as ArduPilot counts."""
    items = [(WAYPOINT, ABOVE_SEA, around(home, 0, 0), home.absolute_altitude_m)]
    items += [(TAKEOFF, ABOVE_HOME, around(home, 0, 0), height_m)]
    items += [(WAYPOINT, ABOVE_HOME, around(home, size_m * n, size_m * e), height_m) for n, e in PLACES]
    items += [(RETURN, ABOVE_HOME, (0, 0), 0)] if returns else []
    return [
        mission_raw.MissionItem(
            *(seq, frame, command, int(seq == 0), 1, 0.0, 0.0, 0.0, 0.0),
            *(round(degrees * 1e7) for degrees in place),
            *(height, 0),
        )
        for seq, (command, frame, place, height) in enumerate(items)
    ]


async def fly(telemetry, plan, pause_at):
    await plan.start_mission()
    async for progress in plan.subscribe_mission_progress():
        say(f"mission: {progress.current} of {progress.total}")
        if progress.current == pause_at:
            pause_at = None
            await plan.pause_mission()
            mode = await first(telemetry.subscribe_flight_mode(), lambda mode: mode.name == "HOLD")
            say("paused:", mode.name)
            await plan.start_mission()
        if progress.current == progress.total:
            return


async def main(url, raw, fixed_wing):
    size_m, height_m = (500.0, 60.0) if fixed_wing else (40.0, 15.0)
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with Mavsdk(configuration) as mavsdk:
        await mavsdk.add_any_connection(url)
        system = await mavsdk.first_autopilot(timeout_s=30)
        telemetry, action = TelemetryAsync(system), ActionAsync(system)
        await first(telemetry.subscribe_health(), lambda health: health.is_armable)
        home = await first(telemetry.subscribe_home())
        await GeofenceAsync(system).upload_geofence(fence(home, 2 * size_m))
        kept = await GeofenceAsync(system).download_geofence()
        say("fence:", len(kept.polygons[0].points), "corners")
        if raw:
            plan = MissionRawAsync(system)
            await plan.upload_mission(raw_items(home, size_m, height_m, not fixed_wing))
            say("uploaded:", len(await plan.download_mission()), "items")
            await action.arm()
        else:
            plan = MissionAsync(system)
            await plan.upload_mission(waypoints(home, size_m, height_m))
            await action.set_takeoff_altitude(height_m)
            await action.arm()
            await action.takeoff()
            await first(telemetry.subscribe_position(), lambda p: p.relative_altitude_m > 0.9 * height_m)
        await fly(telemetry, plan, pause_at=2)
        if not raw:
            say("finished:", await plan.is_mission_finished())
        await plan.clear_mission()
        await action.return_to_launch()
        mode = await first(telemetry.subscribe_flight_mode(), lambda m: m.name == "RETURN_TO_LAUNCH")
        say("mode:", mode.name)


parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("url", nargs="?", default="tcpout://127.0.0.1:6760")
parser.add_argument("--raw", action="store_true")
parser.add_argument("--fixed-wing", action="store_true")
arguments = parser.parse_args()
asyncio.run(main(arguments.url, arguments.raw or arguments.fixed_wing, arguments.fixed_wing))
