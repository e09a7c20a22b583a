"""What each command sends to ArduCopter and ArduPlane, and when its goal is reached.

Each function takes the state at the time of the request and returns a ``Plan``. A caller's mistake (a mode
that the vehicle lacks, a latitude of 100 degrees) raises ``ValueError`` with the value and what is allowed.
"""

from __future__ import annotations

import math
from typing import Any, Final

from aps.timeouts import LANDING_TIMEOUT_S, MODE_TIMEOUT_S
from aps.vehicle.commands import Plan, Step
from aps.vehicle.telemetry import AircraftState
from aps.wire.dialect import AUTOPILOT_COMPID, is_plane, mavlink, mode_numbers

__all__ = ["arm", "disarm", "goto", "land", "rtl", "set_mode", "takeoff"]

EARTH_RADIUS_M: Final = 6_378_137.0
COPTER_RADIUS_M: Final = 2.0
COPTER_HEIGHT_M: Final = 1.0
PLANE_RADIUS_M: Final = 200.0
"""A fixed wing circles its target, at ArduPlane's WP_LOITER_RAD (60 m unless set, 120 m for our Aerosonde) and wider
while it turns in: within this of it counts as there."""
PLANE_HEIGHT_M: Final = 15.0
SLOWEST_MPS: Final = 0.5
"""For time-outs: a leg that is flown slower than this has failed."""
FORCE_DISARM: Final = 21196.0


def _command_long(state: AircraftState, command: int, *params: float) -> Step:
    padded = [*params, *[0.0] * (7 - len(params))]

    def message(confirmation: int) -> Any:
        return mavlink.MAVLink_command_long_message(
            state.sysid, AUTOPILOT_COMPID, command, confirmation, *padded
        )

    return Step(message, command=command)


def _is_fixed_wing(state: AircraftState) -> bool:
    return state.vehicle_type == int(mavlink.MAV_TYPE_FIXED_WING)


def _mode_step(state: AircraftState, mode: str) -> Step:
    numbers = mode_numbers(state.vehicle_type)
    if not numbers:
        raise ValueError(
            f"no modes are known for MAV_TYPE {state.vehicle_type}; has the autopilot been heard?"
        )
    if mode not in numbers:
        raise ValueError(f"mode {mode!r} is none of {', '.join(numbers)}")
    enabled = float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
    return _command_long(state, int(mavlink.MAV_CMD_DO_SET_MODE), enabled, float(numbers[mode]))


def _finite(name: str, value: float, low: float, high: float) -> float:
    if not low <= value <= high:
        raise ValueError(f"{name} must be in {low:g}..{high:g}, not {value!r}")
    return float(value)


def horizontal_distance_m(state: AircraftState, lat_deg: float, lon_deg: float) -> float:
    """Distance over ground, m, flat around the point: for telling that it is reached, not for navigation."""
    north_rad = math.radians(state.lat_deg - lat_deg)
    east_rad = math.radians((state.lon_deg - lon_deg + 180.0) % 360.0 - 180.0) * math.cos(
        math.radians(lat_deg)
    )
    return EARTH_RADIUS_M * math.hypot(north_rad, east_rad)


def arm(state: AircraftState) -> Plan:
    """Arm the motors."""
    step = _command_long(state, int(mavlink.MAV_CMD_COMPONENT_ARM_DISARM), 1.0)
    return Plan("arm", (step,), lambda now: now.armed, MODE_TIMEOUT_S, flight=False)


def disarm(state: AircraftState, *, force: bool = False) -> Plan:
    """Disarm the motors; the autopilot refuses in flight unless forced."""
    magic = FORCE_DISARM if force else 0.0
    step = _command_long(state, int(mavlink.MAV_CMD_COMPONENT_ARM_DISARM), 0.0, magic)
    hint = "in flight only with force"
    return Plan("disarm", (step,), lambda now: not now.armed, MODE_TIMEOUT_S, refusal_hint=hint, flight=False)


def set_mode(state: AircraftState, mode: str) -> Plan:
    """Change the flight mode, by ArduPilot's name for it (``GUIDED``, ``LOITER``, ``FBWA``, ...)."""
    name = mode.upper()
    return Plan("mode", (_mode_step(state, name),), lambda now: now.mode == name, MODE_TIMEOUT_S)


def takeoff(state: AircraftState, alt_rel_m: float) -> Plan:
    """Climb to a height above home. The UA must be armed.

    Copters and VTOL: GUIDED and NAV_TAKEOFF. Fixed wing: the TAKEOFF mode with TKOFF_ALT set.
    """
    height_m = _finite("alt_rel_m", alt_rel_m, 0.5, 10_000.0)
    tolerance_m = max(0.5, 0.05 * height_m)
    mode = "TAKEOFF" if _is_fixed_wing(state) else "GUIDED"
    if _is_fixed_wing(state):
        steps = (_parameter_step(state, "TKOFF_ALT", height_m), _mode_step(state, mode))
    else:
        climb = _command_long(state, int(mavlink.MAV_CMD_NAV_TAKEOFF), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m)
        steps = (_mode_step(state, mode), climb)
    return Plan(
        "takeoff",
        steps,
        lambda now: now.alt_rel_m >= height_m - tolerance_m,
        timeout_s=30.0 + height_m / SLOWEST_MPS,
        remaining_m=lambda now: max(0.0, height_m - now.alt_rel_m),
        mode=mode,
        needs_armed=True,
        refusal_hint="" if state.armed else "the UA is not armed",
    )


def _parameter_step(state: AircraftState, name: str, value: float) -> Step:
    def message(_: int) -> Any:
        return mavlink.MAVLink_param_set_message(
            state.sysid, AUTOPILOT_COMPID, name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32
        )

    return Step(message, parameter=name, value=value)


def goto(
    state: AircraftState, lat_deg: float, lon_deg: float, alt_rel_m: float, speed_mps: float | None = None
) -> Plan:
    """Fly to a point in GUIDED and hold (a fixed wing: circle) there.

    Args:
        state: the UA now.
        lat_deg: latitude of the point.
        lon_deg: longitude of the point.
        alt_rel_m: height above home.
        speed_mps: ground speed (fixed wing: airspeed); ``None`` leaves the autopilot's own.
    """
    lat = _finite("lat_deg", lat_deg, -90.0, 90.0)
    lon = _finite("lon_deg", lon_deg, -180.0, 180.0)
    height_m = _finite("alt_rel_m", alt_rel_m, -1000.0, 10_000.0)
    plane = is_plane(state.vehicle_type)
    radius_m, tolerance_m = (PLANE_RADIUS_M, PLANE_HEIGHT_M) if plane else (COPTER_RADIUS_M, COPTER_HEIGHT_M)

    def remaining_m(now: AircraftState) -> float:
        return math.hypot(horizontal_distance_m(now, lat, lon), now.alt_rel_m - height_m)

    def reached(now: AircraftState) -> bool:
        level = abs(now.alt_rel_m - height_m) <= tolerance_m
        return level and horizontal_distance_m(now, lat, lon) <= radius_m

    steps = [_mode_step(state, "GUIDED"), _reposition_step(state, lat, lon, height_m)]
    if speed_mps is not None:
        steps.append(_speed_step(state, _finite("speed_mps", speed_mps, 0.1, 200.0), airspeed=plane))
    distance_m = remaining_m(state)
    leg_s = distance_m / SLOWEST_MPS if math.isfinite(distance_m) else LANDING_TIMEOUT_S
    return Plan(
        "goto",
        tuple(steps),
        reached,
        timeout_s=60.0 + leg_s,
        remaining_m=remaining_m,
        mode="GUIDED",
        needs_armed=True,
    )


def _reposition_step(state: AircraftState, lat_deg: float, lon_deg: float, height_m: float) -> Step:
    command = int(mavlink.MAV_CMD_DO_REPOSITION)

    def message(_: int) -> Any:
        return mavlink.MAVLink_command_int_message(
            state.sysid,
            AUTOPILOT_COMPID,
            mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
            command,
            0,
            0,
            -1.0,
            float(mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE),
            0.0,
            math.nan,
            round(lat_deg * 1e7),
            round(lon_deg * 1e7),
            height_m,
        )

    return Step(message, command=command)


def _speed_step(state: AircraftState, speed_mps: float, *, airspeed: bool) -> Step:
    kind = mavlink.SPEED_TYPE_AIRSPEED if airspeed else mavlink.SPEED_TYPE_GROUNDSPEED
    step = _command_long(state, int(mavlink.MAV_CMD_DO_CHANGE_SPEED), float(kind), speed_mps, -1.0)
    return Step(step.message, command=step.command, optional=True)


def _is_down(state: AircraftState) -> bool:
    return not state.armed or state.landed_state == "on_ground"


def _height_m(state: AircraftState) -> float:
    return max(0.0, state.alt_rel_m)


def rtl(state: AircraftState) -> Plan:
    """Return to launch: a copter is there once it has landed, a fixed wing once it circles over home."""

    def over_home(now: AircraftState) -> bool:
        home_m = horizontal_distance_m(now, now.home_lat_deg, now.home_lon_deg)
        return _is_down(now) or home_m <= PLANE_RADIUS_M

    return Plan(
        "rtl",
        (_mode_step(state, "RTL"),),
        over_home if _is_fixed_wing(state) else _is_down,
        timeout_s=_way_home_s(state),
        remaining_m=lambda now: _finite_or_none(
            math.hypot(horizontal_distance_m(now, now.home_lat_deg, now.home_lon_deg), _height_m(now))
        ),
        mode="RTL",
    )


def _way_home_s(state: AircraftState) -> float:
    way_m = horizontal_distance_m(state, state.home_lat_deg, state.home_lon_deg)
    return LANDING_TIMEOUT_S + (way_m / SLOWEST_MPS if math.isfinite(way_m) else 0.0)


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def land(state: AircraftState) -> Plan:
    """Land: a copter where it is (LAND), VTOL likewise (QLAND), a fixed wing by AUTOLAND."""
    mode = "LAND"
    if is_plane(state.vehicle_type):
        mode = "AUTOLAND" if _is_fixed_wing(state) else "QLAND"
    return Plan(
        "land",
        (_mode_step(state, mode),),
        _is_down,
        LANDING_TIMEOUT_S,
        remaining_m=lambda now: _finite_or_none(_height_m(now)),
        mode=mode,
    )
