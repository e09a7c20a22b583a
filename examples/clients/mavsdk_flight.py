"""Fly a vehicle with MAVSDK (pip install mavsdk): arm, take off, go somewhere, fly by velocities, return.

    python mavsdk_flight.py tcpout://127.0.0.1:6760

With PX4: --parameter MPC_XY_CRUISE.

ArduPlane refuses MAVSDK's take-off and has no velocities: with --fixed-wing it takes off by a mission.
"""

import argparse
import asyncio
import math
import sys

from mavsdk import ComponentType, Configuration
from mavsdk.asyncio import Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.asyncio.plugins.offboard import OffboardAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.mission_raw import MissionItem
from mavsdk.plugins.offboard import VelocityNedYaw

DEG_PER_M = 1 / 111_320


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


async def take_off(telemetry, action, height_m):
    await action.set_takeoff_altitude(height_m)
    await action.arm()
    say("armed:", await first(telemetry.subscribe_armed(), bool))
    await action.takeoff()


async def take_off_fixed_wing(telemetry, action, plan, height_m):
    """By a mission whose item 0 is home, as ArduPilot counts."""
    home, above_sea, above_home, takeoff, waypoint = await first(telemetry.subscribe_home()), 0, 6, 22, 16
    place = (round(home.latitude_deg * 1e7), round(home.longitude_deg * 1e7))
    items = [
        MissionItem(0, above_sea, waypoint, 1, 1, 0.0, 0.0, 0.0, 0.0, *place, home.absolute_altitude_m, 0),
        MissionItem(1, above_home, takeoff, 0, 1, 0.0, 0.0, 0.0, 0.0, *place, height_m, 0),
    ]
    await plan.upload_mission(items)
    await action.arm()
    say("armed:", await first(telemetry.subscribe_armed(), bool))
    await plan.start_mission()


async def go_north(telemetry, action, distance_m, near_m):
    """Fly to a point north of here, 5 m higher."""
    here = await telemetry.position()
    goal_deg, height_m = here.latitude_deg + distance_m * DEG_PER_M, here.absolute_altitude_m + 5.0
    await action.goto_location(goal_deg, here.longitude_deg, height_m, math.nan)
    there = await first(
        telemetry.subscribe_position(), lambda p: abs(p.latitude_deg - goal_deg) < near_m * DEG_PER_M
    )
    say(f"north: {(there.latitude_deg - here.latitude_deg) / DEG_PER_M:.0f} m")


async def fly_velocities(telemetry, offboard):
    """Three metres a second to the east by setpoints, which MAVSDK repeats; then let go."""
    await offboard.set_velocity_ned(VelocityNedYaw(0.0, 0.0, 0.0, 0.0))
    await offboard.start()
    await offboard.set_velocity_ned(VelocityNedYaw(0.0, 3.0, 0.0, 90.0))
    velocity = await first(telemetry.subscribe_velocity_ned(), lambda v: v.east_m_s > 2.7)
    say(f"offboard: {velocity.east_m_s:.0f} m/s east")
    await offboard.stop()
    await first(telemetry.subscribe_velocity_ned(), lambda v: math.hypot(v.north_m_s, v.east_m_s) < 0.3)
    say("offboard stopped, mode", (await telemetry.flight_mode()).name)


async def main(url, fixed_wing, parameter):
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with Mavsdk(configuration) as mavsdk:
        await mavsdk.add_any_connection(url)
        system = await mavsdk.first_autopilot(timeout_s=30)
        say("system:", await system.get_system_id(), (await system.vehicle_type()).name)
        telemetry, action, param = TelemetryAsync(system), ActionAsync(system), ParamAsync(system)
        name = parameter or ("RTL_RADIUS" if fixed_wing else "WPNAV_RADIUS")
        everything = await param.get_all_params()
        say("parameters:", len(everything.int_params) + len(everything.float_params))
        say(f"{name} =", await (param.get_param_int if fixed_wing else param.get_param_float)(name))
        health = await first(telemetry.subscribe_health(), lambda health: health.is_armable)
        say("health: global position", health.is_global_position_ok, "home", health.is_home_position_ok)
        height_m = 50.0 if fixed_wing else 10.0
        if fixed_wing:
            await take_off_fixed_wing(telemetry, action, MissionRawAsync(system), height_m)
        else:
            await take_off(telemetry, action, height_m)
        await first(telemetry.subscribe_position(), lambda p: p.relative_altitude_m > 0.9 * height_m)
        say("in the air:", await first(telemetry.subscribe_in_air(), bool))
        await go_north(telemetry, action, *((400.0, 150.0) if fixed_wing else (40.0, 2.0)))
        if not fixed_wing:
            await fly_velocities(telemetry, OffboardAsync(system))
        await action.hold()
        say("hold:", (await first(telemetry.subscribe_flight_mode(), lambda m: m.name == "HOLD")).name)
        await action.return_to_launch()
        await first(telemetry.subscribe_flight_mode(), lambda mode: mode.name == "RETURN_TO_LAUNCH")
        say("returns")
        if not fixed_wing:
            await first(telemetry.subscribe_armed(), lambda armed: not armed)
            say("landed and disarmed")


parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("url", nargs="?", default="tcpout://127.0.0.1:6760")
parser.add_argument("--fixed-wing", action="store_true")
parser.add_argument("--parameter", help="one to read, a float (a whole number with --fixed-wing)")
arguments = parser.parse_args()
asyncio.run(main(arguments.url, arguments.fixed_wing, arguments.parameter))
