"""Where to fly to: points, velocities, moving targets. Frames are in the names of the arguments.

ArduPilot flies there in GUIDED, PX4 in AUTO.LOITER (points) and OFFBOARD (setpoints). A newer one of these supersedes
the one before. Setpoints (velocities, moving targets, circles, local points) have no acknowledgement: the daemon
repeats them, as autopilots want it (ArduCopter stops 3 s after the last velocity, PX4 leaves OFFBOARD after 1 s).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import Any, Final

from aps.timeouts import MODE_TIMEOUT_S
from aps.vehicle.autopilots.autopilot import Manoeuvre, Target
from aps.vehicle.autopilots.choice import autopilot_of
from aps.vehicle.commands.plan import CommandPlan, Echo
from aps.vehicle.execution import Refusal
from aps.vehicle.flight.plans import change_speed
from aps.vehicle.flight.returning import PLANE_RADIUS_M, WAY_LAG_S, WAY_M
from aps.vehicle.flight.setpoints import NO_POSITION, ZERO, Yaw, leg_s, local_setpoint, offset_deg, place_of
from aps.vehicle.flight.steps import checked, command_long, finite_or_none, horizontal_distance_m
from aps.vehicle.state import Vector3, VehicleState
from aps.wire.dialect import is_ground, is_plane, mavlink

COPTER_RADIUS_M: Final = 2.0
COPTER_HEIGHT_M: Final = 1.0
PLANE_HEIGHT_M: Final = 15.0
STILL_MPS: Final = 0.3
LEAST_RATE_HZ: Final = 1.0
"""Of setpoints: ArduCopter's time-out is 3 s."""
MOST_RATE_HZ: Final = 50.0
POINT_PERIOD_S: Final = 1.0
"""Between two repetitions of a point."""
ECHO_M: Final = 0.5
"""From a point that was taken to what the autopilot says of it; it keeps centimetres."""
_ECHO: Final = mavlink.MAVLink_position_target_local_ned_message

FRAMES: Final = ("relative", "amsl", "terrain")
"""What a height counts from: home, mean sea level, the ground below."""
LOCAL_FRAMES: Final = {
    "origin": int(mavlink.MAV_FRAME_LOCAL_NED),
    "offset": mavlink.MAV_FRAME_LOCAL_OFFSET_NED,
    "body": mavlink.MAV_FRAME_BODY_OFFSET_NED,
}
VELOCITY_FRAMES: Final = {
    "ned": int(mavlink.MAV_FRAME_LOCAL_NED),
    "body": int(mavlink.MAV_FRAME_BODY_NED),
}


def _choice(name: str, value: str, among: Collection[str]) -> str:
    if value not in among:
        raise ValueError(f"{name} {value!r} is none of {', '.join(among)}")
    return value


def goto(
    state: VehicleState,
    lat_deg: float,
    lon_deg: float,
    alt_rel_m: float,
    speed_mps: float | None = None,
    yaw_deg: float | None = None,
    frame: str = "relative",
    within_m: float | None = None,
) -> CommandPlan:
    """Fly to a point and hold (a fixed wing: circle) there.

    Args:
        state: the UA now.
        lat_deg: latitude of the point.
        lon_deg: longitude of the point.
        alt_rel_m: height, by default above home; see ``frame``.
        speed_mps: ground speed (fixed wing: airspeed); ``None`` leaves the autopilot's own.
        yaw_deg: heading of the nose from north, clockwise; ``None`` as the autopilot likes. Not for planes.
        frame: what the height counts from: ``relative`` home, ``amsl`` mean sea level, ``terrain`` the ground below.
        within_m: how near to the point, over ground, counts as there; ``None``: 2, of a plane 200. (The height
            has to be right within 1 m, of a plane 15.)
    """
    lat, lon, height_m = place_of(lat_deg, lon_deg, alt_rel_m)
    _choice("frame", frame, FRAMES)
    plane = is_plane(state.vehicle_type)
    if yaw_deg is not None and plane:
        raise ValueError("yaw_deg: a plane points where it flies")
    radius_m, tolerance_m = (PLANE_RADIUS_M, PLANE_HEIGHT_M) if plane else (COPTER_RADIUS_M, COPTER_HEIGHT_M)
    radius_m = radius_m if within_m is None else _near_m(within_m)

    def climb_m(now: VehicleState) -> float:
        if frame == "terrain" or is_ground(now.vehicle_type):
            return 0.0  # what the height above the ground is, only the autopilot knows
        return height_m - (now.alt_amsl_m if frame == "amsl" else now.alt_rel_m)

    def remaining_m(now: VehicleState) -> float:
        return math.hypot(horizontal_distance_m(now, lat, lon), climb_m(now))

    if speed_mps is not None:
        checked("speed_mps", speed_mps, 0.1, 200.0)
    if yaw_deg is not None:
        checked("yaw_deg", yaw_deg, -360.0, 360.0)
    way = autopilot_of(state.autopilot).goto(state, Target((lat, lon, height_m), frame, speed_mps, yaw_deg))
    return CommandPlan(
        "goto",
        way.steps,
        lambda now: abs(climb_m(now)) <= tolerance_m and horizontal_distance_m(now, lat, lon) <= radius_m,
        timeout_s=leg_s(remaining_m(state)),
        after_circle=way.after_circle,
        remaining_m=lambda now: finite_or_none(remaining_m(now)),
        modes=way.modes,
        needs_armed=True,
        refusal_hint=way.refusal_hint,
        rejection_texts=way.rejection_texts,
        interruption_texts=way.interruption_texts,
        target=True,
    )


def _near_m(within_m: float) -> float:
    return checked("within_m", within_m, 0.1, 10_000.0)


def hold(state: VehicleState) -> CommandPlan:
    """Stay here: a copter stops and keeps its place and height without a pilot, a plane circles.

    Done when a copter stands still, a plane is in its mode for that.
    """
    way = autopilot_of(state.autopilot).hold(state)
    plane = is_plane(state.vehicle_type)

    def reached(now: VehicleState) -> bool:
        return now.mode in way.modes and (plane or math.dist(now.velocity_ned_mps, ZERO) <= STILL_MPS)

    return CommandPlan(
        "hold",
        way.steps,
        reached,
        timeout_s=MODE_TIMEOUT_S if plane else leg_s(0.0),
        modes=way.modes,
        needs_armed=True,
        target=True,
        may_stand=True,
        setpoint=_stand_still if way.by_setpoints else None,
        setpoint_period_s=POINT_PERIOD_S,
        stop_messages=way.stop_messages,
    )


def _stand_still(now: VehicleState, _: float) -> Any:
    return local_setpoint(now, int(mavlink.MAV_FRAME_LOCAL_NED), None, ZERO, Yaw())


def goto_ned(
    state: VehicleState,
    north_m: float,
    east_m: float,
    down_m: float,
    frame: str = "origin",
    speed_mps: float | None = None,
    yaw_deg: float | None = None,
    yaw_rate_dps: float | None = None,
    within_m: float | None = None,
) -> CommandPlan:
    """Fly to a point in local metres, and hold there. Not for planes.

    Args:
        state: the UA now.
        north_m: north of the point (``body``: ahead).
        east_m: east of the point (``body``: to the right).
        down_m: down of the point; negative is up.
        frame: ``origin`` counts from the autopilot's local origin, ``offset`` from where the UA is now, ``body`` from
            there and along its heading of now.
        speed_mps: over ground; ``None`` leaves the autopilot's own. With one, PX4 flies there as by ``goto``.
        yaw_deg: heading of the nose; ``None`` as the autopilot likes.
        yaw_rate_dps: rate of turn, instead of a heading.
        within_m: how near to the point counts as there; ``None``: 2.

    Raises:
        Refusal: ``offset`` and ``body`` without a position yet; a plane.
    """
    autopilot = autopilot_of(state.autopilot)
    way = autopilot.setpoints(state, "goto_ned")
    yaw = Yaw(yaw_deg, yaw_rate_dps)
    asked = [
        checked(name, value, -1e6, 1e6)
        for name, value in (("north_m", north_m), ("east_m", east_m), ("down_m", down_m))
    ]
    goal = _from_origin(state, (asked[0], asked[1], asked[2]), frame)
    radius_m = COPTER_RADIUS_M if within_m is None else _near_m(within_m)
    if speed_mps is not None and not way.keeps_speed:
        return _by_place(state, goal, speed_mps, yaw, within_m)
    [speed] = [None] if speed_mps is None else change_speed(state, speed_mps, "ground").steps

    def remaining_m(now: VehicleState) -> float:
        return math.dist(now.position_ned_m, goal)

    return CommandPlan(
        "goto_ned",
        way.steps,
        lambda now: remaining_m(now) <= radius_m,
        timeout_s=leg_s(remaining_m(state)),
        remaining_m=lambda now: finite_or_none(remaining_m(now)),
        modes=way.modes,
        needs_armed=True,
        target=True,
        setpoint=lambda now, _: local_setpoint(now, LOCAL_FRAMES["origin"], goal, None, yaw),
        setpoint_period_s=min(POINT_PERIOD_S, way.longest_period_s),
        lead_s=way.lead_s,
        stop_messages=lambda now: autopilot.stay_at(now, goal, yaw),
        beside=None if speed is None else speed.message(0),
        echo=_echo(state, goal, way.silent_refusal) if way.silent_refusal else None,
    )


def _by_place(
    state: VehicleState, goal: Vector3, speed_mps: float, yaw: Yaw, within_m: float | None
) -> CommandPlan:
    """The point by its latitude and longitude: a target that has a speed, where setpoints have none."""
    if yaw.rate_dps is not None:
        raise Refusal("this autopilot flies points at a speed with a yaw_deg, and none with a yaw_rate_dps")
    north, east, down = (there - here for there, here in zip(goal, state.position_ned_m, strict=True))
    if not all(map(math.isfinite, (north, east, down, state.lat_deg, state.alt_amsl_m))):
        raise Refusal("where the UA is is not known yet")
    place = offset_deg(state.lat_deg, state.lon_deg, north, east)
    plan = goto(state, *place, state.alt_amsl_m - down, speed_mps, yaw.yaw_deg, "amsl", within_m)
    return replace(plan, verb="goto_ned")


def _echo(state: VehicleState, goal: Vector3, why: str) -> Echo:
    """POSITION_TARGET_LOCAL_NED, by which an autopilot says what point it flies to."""

    def is_ours(fields: Mapping[str, Any]) -> bool:
        target = fields["x"], fields["y"], fields["z"]
        return not fields["type_mask"] & NO_POSITION and math.dist(target, goal) <= ECHO_M

    def is_true(fields: Mapping[str, Any], now: VehicleState) -> bool:
        """With GUID_OPTIONS 64 ArduCopter says a point of before, or 0; NAV_CONTROLLER_OUTPUT has its way to go."""
        said = fields["x"], fields["y"]
        is_above = any(said) and math.dist(said, goal[:2]) <= ECHO_M
        way_m = math.dist(now.position_ned_m[:2], goal[:2])
        goes_elsewhere = abs(now.waypoint_distance_m - way_m) > WAY_M + WAY_LAG_S * now.groundspeed_mps
        return bool(fields["type_mask"] & NO_POSITION) or is_above or goes_elsewhere

    ask = command_long(state, int(mavlink.MAV_CMD_REQUEST_MESSAGE), float(_ECHO.id)).message(0)
    return Echo(_ECHO.msgname, ask, is_ours, is_true, f"the autopilot does not take this point: {why}")


def _from_origin(state: VehicleState, offset_m: Vector3, frame: str) -> Vector3:
    """A point of one of ``LOCAL_FRAMES`` as metres from the local origin: so it can be repeated while the UA moves."""
    _choice("frame", frame, LOCAL_FRAMES)
    if frame == "origin":
        return offset_m
    north, east, down = _turned(state, offset_m) if frame == "body" else offset_m
    own = state.position_ned_m
    goal = (own[0] + north, own[1] + east, own[2] + down)
    if not all(math.isfinite(value) for value in goal):
        raise Refusal(f"frame {frame!r} counts from the UA, and where it is is not known yet")
    return goal


def _turned(state: VehicleState, vector: Vector3) -> Vector3:
    """North, east and down of what is given ahead, to the right and down."""
    cos_yaw, sin_yaw = math.cos(state.yaw_rad), math.sin(state.yaw_rad)
    ahead, right, down = vector
    return (cos_yaw * ahead - sin_yaw * right, sin_yaw * ahead + cos_yaw * right, down)


def velocity(
    state: VehicleState,
    north_mps: float,
    east_mps: float,
    down_mps: float = 0.0,
    yaw_deg: float | None = None,
    yaw_rate_dps: float | None = None,
    frame: str = "ned",
    duration_s: float = 3.0,
    rate_hz: float = 5.0,
) -> CommandPlan:
    """Fly at a velocity for a time, then stop. A newer target before that takes over without a stop.

    Args:
        state: the UA now.
        north_mps: velocity over ground to the north (``body``: ahead).
        east_mps: to the east (``body``: to the right).
        down_mps: down; negative climbs.
        yaw_deg: heading of the nose; ``None`` as the autopilot likes.
        yaw_rate_dps: rate of turn, instead of a heading.
        frame: ``ned``, or ``body`` for along the heading, which may turn meanwhile.
        duration_s: for how long, by the autopilot's clock.
        rate_hz: how often the setpoint is repeated.
    """
    way = autopilot_of(state.autopilot).setpoints(state, "velocity")
    mav_frame = VELOCITY_FRAMES[_choice("frame", frame, VELOCITY_FRAMES)]
    yaw = Yaw(yaw_deg, yaw_rate_dps)
    speeds = [
        checked(name, value, -100.0, 100.0)
        for name, value in (("north_mps", north_mps), ("east_mps", east_mps), ("down_mps", down_mps))
    ]
    wanted = (speeds[0], speeds[1], speeds[2])

    def setpoint(now: VehicleState) -> Any:
        if frame == "body" and yaw_deg is not None:
            # ArduCopter takes a yaw in BODY_NED for a turn from where the nose is: repeated, it would turn on and on.
            return local_setpoint(now, VELOCITY_FRAMES["ned"], None, _turned(now, wanted), yaw)
        return local_setpoint(now, mav_frame, None, wanted, yaw)

    return _repeated(way, "velocity", lambda now, _: setpoint(now), duration_s, rate_hz)


def follow(
    state: VehicleState,
    lat_deg: float,
    lon_deg: float,
    alt_rel_m: float,
    north_mps: float = 0.0,
    east_mps: float = 0.0,
    down_mps: float = 0.0,
    yaw_deg: float | None = None,
    duration_s: float = 3.0,
    rate_hz: float = 5.0,
) -> CommandPlan:
    """Fly with a moving target, whose position and velocity are those of now; then stop. Call again with newer ones.

    Args:
        state: the UA now.
        lat_deg: latitude of the target.
        lon_deg: longitude of the target.
        alt_rel_m: its height above home.
        north_mps: its velocity over ground to the north; between two calls it is taken to fly straight on.
        east_mps: its velocity to the east.
        down_mps: its velocity down.
        yaw_deg: heading of the nose; ``None`` as the autopilot likes.
        duration_s: for how long to go on without a newer call, by the autopilot's clock.
        rate_hz: how often the setpoint is sent.
    """
    autopilot = autopilot_of(state.autopilot)
    way = autopilot.setpoints(state, "follow")
    lat, lon, height_m = place_of(lat_deg, lon_deg, alt_rel_m)
    yaw = Yaw(yaw_deg)
    north = checked("north_mps", north_mps, -100.0, 100.0)
    east = checked("east_mps", east_mps, -100.0, 100.0)
    down = checked("down_mps", down_mps, -100.0, 100.0)

    def setpoint(now: VehicleState, elapsed_s: float) -> Any:
        place = offset_deg(lat, lon, north * elapsed_s, east * elapsed_s)
        there = (*place, height_m - down * elapsed_s)
        return autopilot.global_setpoint(now, there, (north, east, down), yaw)

    return _repeated(way, "follow", setpoint, duration_s, rate_hz)


def _repeated(
    way: Manoeuvre,
    verb: str,
    setpoint: Callable[[VehicleState, float], Any],
    duration_s: float,
    rate_hz: float,
) -> CommandPlan:
    """Setpoints for a time, then a stop."""
    period_s = 1.0 / checked("rate_hz", rate_hz, LEAST_RATE_HZ, MOST_RATE_HZ)
    return CommandPlan(
        verb,
        way.steps,
        lambda _: False,
        timeout_s=math.inf,
        modes=way.modes,
        needs_armed=True,
        target=True,
        setpoint=setpoint,
        setpoint_period_s=min(period_s, way.longest_period_s),
        lead_s=way.lead_s,
        duration_s=checked("duration_s", duration_s, 0.0, 86_400.0),
        stop_messages=way.stop_messages,
    )
