"""What each command sends to ArduCopter and ArduPlane, and when its goal is reached.

Each function takes the state at the time of the request and returns a ``CommandPlan``. A caller's mistake (a mode
that the vehicle lacks, a latitude of 100 degrees) raises ``ValueError`` with the value and what is allowed.
"""

from __future__ import annotations

import math
from typing import Any, Final

from aps.timeouts import LANDING_TIMEOUT_S, MODE_TIMEOUT_S, REBOOT_TIMEOUT_S
from aps.vehicle.commands import ARMING, CommandPlan, Step
from aps.vehicle.execution import Refusal
from aps.vehicle.telemetry import VehicleState
from aps.wire.dialect import ARDUPILOT, AUTOPILOT_COMPID, PX4, is_copter, is_plane, mavlink, mode_numbers

__all__ = ["arm", "change_speed", "disarm", "land", "reboot", "rtl", "set_mode", "takeoff"]

EARTH_RADIUS_M: Final = 6_378_137.0
PLANE_RADIUS_M: Final = 200.0
"""A fixed wing circles its target, at ArduPlane's WP_LOITER_RAD (60 m unless set, 120 m for our Aerosonde) and wider
while it turns in: within this of it counts as there."""
SLOWEST_MPS: Final = 0.5
"""For time-outs: a leg that is flown slower than this has failed."""
FORCE_DISARM: Final = 21196.0
STICK_MODES: Final = frozenset({"ALT_HOLD", "CIRCLE", "FLOWHOLD", "LOITER", "POSHOLD", "SPORT", "ZIGZAG"})
"""ArduCopter's modes in which the throttle stick gives the climb rate: none in the middle, full sinking at zero."""


def command_long(state: VehicleState, command: int, *params: float) -> Step:
    """COMMAND_LONG to the autopilot; parameters that are not given are 0."""
    padded = [*params, *[0.0] * (7 - len(params))]

    def message(confirmation: int) -> Any:
        return mavlink.MAVLink_command_long_message(
            state.sysid, AUTOPILOT_COMPID, command, confirmation, *padded
        )

    return Step(message, command=command)


def is_fixed_wing(state: VehicleState) -> bool:
    """Whether it flies on wings alone (VTOL take off and land as copters do)."""
    return state.vehicle_type == int(mavlink.MAV_TYPE_FIXED_WING)


def mode_step(state: VehicleState, mode: str) -> Step:
    """DO_SET_MODE, in the form that this autopilot takes.

    Raises:
        ValueError: the vehicle has no such mode.
    """
    numbers = mode_numbers(state.vehicle_type, state.autopilot)
    if not numbers:
        raise ValueError(
            f"no modes are known for MAV_TYPE {state.vehicle_type} of MAV_AUTOPILOT {state.autopilot}; "
            "has the autopilot been heard?"
        )
    if mode not in numbers:
        raise ValueError(f"mode {mode!r} is none of {', '.join(numbers)}")
    number = numbers[mode]
    parts = (float(number),) if state.autopilot != PX4 else (float(number >> 16 & 0xFF), float(number >> 24))
    enabled = float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
    return command_long(state, int(mavlink.MAV_CMD_DO_SET_MODE), enabled, *parts)


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


def arm(state: VehicleState) -> CommandPlan:
    """Arm the motors."""
    step = command_long(state, int(mavlink.MAV_CMD_COMPONENT_ARM_DISARM), 1.0)
    return CommandPlan("arm", (step,), lambda now: now.armed, MODE_TIMEOUT_S, occupies=ARMING)


def disarm(state: VehicleState, *, force: bool = False) -> CommandPlan:
    """Disarm the motors; the autopilot refuses in flight unless forced.

    Args:
        state: the UA now.
        force: stop the motors in flight, too: a copter falls.
    """
    magic = FORCE_DISARM if force else 0.0
    step = command_long(state, int(mavlink.MAV_CMD_COMPONENT_ARM_DISARM), 0.0, magic)
    hint = "in flight only with force"
    return CommandPlan(
        "disarm", (step,), lambda now: not now.armed, MODE_TIMEOUT_S, refusal_hint=hint, occupies=ARMING
    )


def set_mode(state: VehicleState, mode: str) -> CommandPlan:
    """Change the flight mode.

    Args:
        state: the UA now.
        mode: the autopilot's name for it (``GUIDED``, ``FBWA``, PX4: ``AUTO.MISSION``, ...).
    """
    if not isinstance(mode, str):
        raise ValueError(f"mode must be a name, not {mode!r}")
    name = mode.upper()
    return CommandPlan(
        "mode",
        (mode_step(state, name),),
        lambda now: now.mode == name,
        MODE_TIMEOUT_S,
        stick_mode=name if name in STICK_MODES and is_copter(state.vehicle_type) else "",
    )


def takeoff(state: VehicleState, alt_rel_m: float) -> CommandPlan:
    """Climb to a height above home. The UA must be armed.

    Copters and VTOL: GUIDED and NAV_TAKEOFF. Fixed wing: the TAKEOFF mode with TKOFF_ALT set.

    Args:
        state: the UA now.
        alt_rel_m: the height, 0.5 to 10000.
    """
    ardupilot_only(state, "takeoff")
    height_m = checked("alt_rel_m", alt_rel_m, 0.5, 10_000.0)
    tolerance_m = max(0.5, 0.05 * height_m)
    mode = "TAKEOFF" if is_fixed_wing(state) else "GUIDED"
    if is_fixed_wing(state):
        steps = (_parameter_step(state, "TKOFF_ALT", height_m), mode_step(state, mode))
    else:
        climb = command_long(state, int(mavlink.MAV_CMD_NAV_TAKEOFF), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m)
        steps = (mode_step(state, mode), climb)
    return CommandPlan(
        "takeoff",
        steps,
        lambda now: now.alt_rel_m >= height_m - tolerance_m,
        timeout_s=30.0 + height_m / SLOWEST_MPS,
        remaining_m=lambda now: max(0.0, height_m - now.alt_rel_m),
        mode=mode,
        needs_armed=True,
        refusal_hint=_why_no_takeoff(state),
    )


def _why_no_takeoff(state: VehicleState) -> str:
    if not state.armed:
        return "the UA is not armed"
    return "it flies already" if state.landed_state in ("takeoff", "in_air", "landing") else ""


def _parameter_step(state: VehicleState, name: str, value: float) -> Step:
    def message(_: int) -> Any:
        return mavlink.MAVLink_param_set_message(
            state.sysid, AUTOPILOT_COMPID, name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32
        )

    return Step(message, parameter=name, value=value)


def _is_down(state: VehicleState) -> bool:
    return not state.armed or state.landed_state == "on_ground"


def _height_m(state: VehicleState) -> float:
    return max(0.0, state.alt_rel_m)


def rtl(state: VehicleState) -> CommandPlan:
    """Return to launch: a copter is there once it has landed, a fixed wing once it circles over home."""

    def over_home(now: VehicleState) -> bool:
        home_m = horizontal_distance_m(now, now.home_lat_deg, now.home_lon_deg)
        return _is_down(now) or home_m <= PLANE_RADIUS_M

    mode = "AUTO.RTL" if state.autopilot == PX4 else "RTL"
    return CommandPlan(
        "rtl",
        (mode_step(state, mode),),
        over_home if is_fixed_wing(state) else _is_down,
        timeout_s=_way_home_s(state),
        remaining_m=lambda now: finite_or_none(
            math.hypot(horizontal_distance_m(now, now.home_lat_deg, now.home_lon_deg), _height_m(now))
        ),
        mode=mode,
    )


def _way_home_s(state: VehicleState) -> float:
    way_m = horizontal_distance_m(state, state.home_lat_deg, state.home_lon_deg)
    return LANDING_TIMEOUT_S + (way_m / SLOWEST_MPS if math.isfinite(way_m) else 0.0)


def ardupilot_only(state: VehicleState, what: str) -> None:
    """Refuse what is ArduPilot's own way.

    Raises:
        Refusal: another autopilot flies.
    """
    if state.autopilot != ARDUPILOT:
        raise Refusal(f"{what} is known of ArduPilot alone, and MAV_AUTOPILOT is {state.autopilot}")


def finite_or_none(value: float) -> float | None:
    """The value, or ``None`` for NaN and infinity."""
    return value if math.isfinite(value) else None


def land(state: VehicleState) -> CommandPlan:
    """Land: a copter where it is (LAND), VTOL likewise (QLAND), a fixed wing by AUTOLAND."""
    mode = "AUTO.LAND" if state.autopilot == PX4 else "LAND"
    if state.autopilot == ARDUPILOT and is_plane(state.vehicle_type):
        mode = "AUTOLAND" if is_fixed_wing(state) else "QLAND"
    return CommandPlan(
        "land",
        (mode_step(state, mode),),
        _is_down,
        LANDING_TIMEOUT_S,
        remaining_m=lambda now: finite_or_none(_height_m(now)),
        mode=mode,
    )


SPEED_KINDS: Final = {"air": 0, "ground": 1, "climb": 2, "descent": 3}
"""Name -> SPEED_TYPE."""


def speed_step(state: VehicleState, speed_mps: float, kind: str) -> Step:
    """DO_CHANGE_SPEED.

    Raises:
        ValueError: the speed is out of range, or there is no such kind.
    """
    if kind not in SPEED_KINDS:
        raise ValueError(f"kind {kind!r} is none of {', '.join(SPEED_KINDS)}")
    speed = checked("speed_mps", speed_mps, 0.1, 200.0)
    return command_long(state, int(mavlink.MAV_CMD_DO_CHANGE_SPEED), float(SPEED_KINDS[kind]), speed, -1.0)


def change_speed(state: VehicleState, speed_mps: float, kind: str | None = None) -> CommandPlan:
    """Change the speed that the autopilot flies at in GUIDED and AUTO, without changing where it flies to.

    Args:
        state: the UA now.
        speed_mps: the speed.
        kind: ``air``, ``ground``, ``climb`` or ``descent``; ``None`` is ``air`` for a plane, ``ground`` for others.
    """
    if kind is None:
        kind = "air" if is_plane(state.vehicle_type) else "ground"
    return CommandPlan(
        "speed", (speed_step(state, speed_mps, kind),), lambda _: True, MODE_TIMEOUT_S, occupies=""
    )


def reboot(state: VehicleState) -> CommandPlan:
    """Have the autopilot boot anew; done when its clock has begun again. It refuses while it is armed."""
    step = command_long(state, int(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN), 1.0)
    hint = "the UA is armed" if state.armed else ""
    return CommandPlan("reboot", (step,), lambda _: False, REBOOT_TIMEOUT_S, refusal_hint=hint, reboots=True)
