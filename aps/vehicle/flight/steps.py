"""Single messages that an autopilot acknowledges, and the checks of what people ask for."""

from __future__ import annotations

import math
from typing import Any, Final

from aps.vehicle.commands.plan import Step
from aps.vehicle.state import VehicleState
from aps.wire.dialect import AUTOPILOT_COMPID, mavlink

EARTH_RADIUS_M: Final = 6_378_137.0
PREARM_CHECK: Final = int(mavlink.MAV_SYS_STATUS_PREARM_CHECK)


def command_long(state: VehicleState, command: int, *params: float) -> Step:
    """COMMAND_LONG to the autopilot; parameters that are not given are 0."""
    padded = [*params, *[0.0] * (7 - len(params))]

    def message(confirmation: int) -> Any:
        return mavlink.MAVLink_command_long_message(
            state.sysid, AUTOPILOT_COMPID, command, confirmation, *padded
        )

    return Step(message, command=command)


def command_int(
    state: VehicleState,
    command: int,
    frame: int,
    params: tuple[float, float, float, float],
    place: tuple[float, float, float],
) -> Step:
    """COMMAND_INT to the autopilot: four parameters, and latitude, longitude, degrees, and height, m."""
    lat_deg, lon_deg, height_m = place

    def message(_: int) -> Any:
        return mavlink.MAVLink_command_int_message(
            state.sysid,
            AUTOPILOT_COMPID,
            frame,
            command,
            0,
            0,
            *params,
            round(lat_deg * 1e7),
            round(lon_deg * 1e7),
            height_m,
        )

    return Step(message, command=command)


def arm_step(state: VehicleState) -> Step:
    """COMPONENT_ARM_DISARM."""
    return command_long(state, int(mavlink.MAV_CMD_COMPONENT_ARM_DISARM), 1.0)


def set_mode(state: VehicleState, *numbers: int) -> Step:
    """DO_SET_MODE with the autopilot's own numbers."""
    enabled = float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
    return command_long(state, int(mavlink.MAV_CMD_DO_SET_MODE), enabled, *map(float, numbers))


def parameter_step(state: VehicleState, name: str, value: float) -> Step:
    """PARAM_SET of a float, answered by its PARAM_VALUE."""

    def message(_: int) -> Any:
        return mavlink.MAVLink_param_set_message(
            state.sysid, AUTOPILOT_COMPID, name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32
        )

    return Step(message, parameter=name, value=value)


def optional(step: Step, hint: str = "") -> Step:
    """The same, but a refusal does not end the command; ``hint`` is added to one without the autopilot's words."""
    return Step(step.message, step.command, step.parameter, step.value, optional=True, hint=hint)


def is_fixed_wing(state: VehicleState) -> bool:
    """Whether it flies on wings alone (VTOL take off and land as copters do)."""
    return state.vehicle_type == int(mavlink.MAV_TYPE_FIXED_WING) and not state.vtol


def checked(name: str, value: float, low: float, high: float) -> float:
    """A number in a range.

    Raises:
        ValueError: it is none, or out of range.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{name} must be a number in {low:g}..{high:g}, not {value!r}")
    if not low <= value <= high:
        raise ValueError(f"{name} must be in {low:g}..{high:g}, not {value!r}")
    return float(value)


def horizontal_distance_m(state: VehicleState, lat_deg: float, lon_deg: float) -> float:
    """Distance over ground, m, flat around the point: to find out that it is reached, not for navigation."""
    north_rad = math.radians(state.lat_deg - lat_deg)
    east_rad = math.radians((state.lon_deg - lon_deg + 180.0) % 360.0 - 180.0) * math.cos(
        math.radians(lat_deg)
    )
    return EARTH_RADIUS_M * math.hypot(north_rad, east_rad)


def finite_or_none(value: float) -> float | None:
    """The value, or ``None`` for NaN and infinity."""
    return value if math.isfinite(value) else None
