"""What each command sends, and when its goal is reached; ``aps.vehicle.autopilots`` says how each autopilot does it.

Each function takes the state at the time of the request and returns a ``CommandPlan``. A caller's mistake (a mode
that the vehicle lacks, a latitude of 100 degrees) raises ``ValueError`` with the value and what is allowed.
"""

from __future__ import annotations

import math
from typing import Final

from aps.timeouts import LANDING_TIMEOUT_S, MODE_TIMEOUT_S, REBOOT_TIMEOUT_S
from aps.vehicle.autopilots.choice import autopilot_of
from aps.vehicle.commands.plan import ARMING, CommandPlan
from aps.vehicle.flight.returning import Returning
from aps.vehicle.flight.setpoints import SLOWEST_MPS
from aps.vehicle.flight.steps import (
    checked,
    command_long,
    finite_or_none,
    horizontal_distance_m,
    is_fixed_wing,
)
from aps.vehicle.state import VehicleState
from aps.wire.dialect import is_plane, mavlink

FORCE_DISARM: Final = 21196.0


def known_mode(state: VehicleState, mode: str) -> str:
    """The autopilot's own name of a mode.

    Raises:
        ValueError: the vehicle has no such mode.
    """
    autopilot = autopilot_of(state.autopilot)
    modes = autopilot.modes(state.vehicle_type)
    if not modes:
        raise ValueError(
            f"no modes are known for MAV_TYPE {state.vehicle_type} of MAV_AUTOPILOT {state.autopilot}; "
            "has the autopilot been heard?"
        )
    name = autopilot.mode_aliases.get(mode, mode)
    if name not in modes:
        raise ValueError(f"mode {mode!r} is none of {', '.join(modes)}")
    return name


def arm(state: VehicleState) -> CommandPlan:
    """Arm the motors."""
    way = autopilot_of(state.autopilot).arm(state)
    return CommandPlan("arm", way.steps, lambda now: now.armed, MODE_TIMEOUT_S, occupies=ARMING)


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
    asked = mode.upper()
    name, autopilot = known_mode(state, asked), autopilot_of(state.autopilot)
    return CommandPlan(
        "mode",
        (autopilot.mode_step(state, name),),
        lambda now: now.mode == name,
        MODE_TIMEOUT_S,
        modes=(name,),
        stick_mode=autopilot.stick_mode(state, name),
        remark="" if name == asked else f"{asked} is {name} of {autopilot.name}",
    )


def takeoff(state: VehicleState, alt_rel_m: float) -> CommandPlan:
    """Climb to a height above home. The UA must be armed; one that flies is refused, and left in its mode.

    ArduPilot: GUIDED and NAV_TAKEOFF, fixed wing the TAKEOFF mode with TKOFF_ALT set. PX4: NAV_TAKEOFF.

    Args:
        state: the UA now.
        alt_rel_m: the height, 0.5 to 10000.
    """
    height_m = checked("alt_rel_m", alt_rel_m, 0.5, 10_000.0)
    way = autopilot_of(state.autopilot).takeoff(state, height_m)
    tolerance_m = max(0.5, 0.05 * height_m)
    return CommandPlan(
        "takeoff",
        way.steps,
        lambda now: now.alt_rel_m >= height_m - tolerance_m,
        timeout_s=30.0 + height_m / SLOWEST_MPS,
        remaining_m=lambda now: max(0.0, height_m - now.alt_rel_m),
        modes=way.modes,
        needs_armed=True,
        launches=is_fixed_wing(state),
        refusal_hint=way.refusal_hint,
        rejection_texts=way.rejection_texts,
        interruption_texts=way.interruption_texts,
    )


def _is_down(state: VehicleState) -> bool:
    return not state.armed or state.landed_state == "on_ground"


def _height_m(state: VehicleState) -> float:
    return max(0.0, state.alt_rel_m)


def rtl(state: VehicleState) -> CommandPlan:
    """Return to launch: a copter is there once it has landed, a fixed wing once it circles over home.

    ArduPlane returns to a rally point, if it has one. Where it goes on to its mission's landing before it is there, it
    is there once it has landed.
    """
    way = autopilot_of(state.autopilot).rtl(state)
    returning = Returning(way.modes)
    return CommandPlan(
        "rtl",
        way.steps,
        lambda now: returning.is_there(now) or _is_down(now),
        timeout_s=_way_home_s(state),
        remaining_m=lambda now: finite_or_none(math.hypot(returning.way_m(now), _height_m(now))),
        modes=way.modes,
        onward_texts=way.onward_texts,
        onward_modes=way.onward_modes,
    )


def _way_home_s(state: VehicleState) -> float:
    way_m = horizontal_distance_m(state, state.home_lat_deg, state.home_lon_deg)
    return LANDING_TIMEOUT_S + (way_m / SLOWEST_MPS if math.isfinite(way_m) else 0.0)


def land(state: VehicleState) -> CommandPlan:
    """Land: a copter or VTOL where it is; a fixed wing of ArduPilot by AUTOLAND, of PX4 where it is."""
    way = autopilot_of(state.autopilot).land(state)
    return CommandPlan(
        "land",
        way.steps,
        _is_down,
        timeout_s=_way_home_s(state) if is_fixed_wing(state) else LANDING_TIMEOUT_S,
        remaining_m=lambda now: finite_or_none(_height_m(now)),
        modes=way.modes,
    )


SPEED_KINDS: Final = ("air", "ground", "climb", "descent")


def change_speed(state: VehicleState, speed_mps: float, kind: str | None = None) -> CommandPlan:
    """Change the speed that the autopilot flies at in GUIDED and AUTO, without changing where it flies to.

    Args:
        state: the UA now.
        speed_mps: the speed.
        kind: ``air``, ``ground``, ``climb`` or ``descent``; ``None`` is ``air`` for a plane, ``ground`` for others.
    """
    if kind is None:
        kind = "air" if is_plane(state.vehicle_type) else "ground"
    if kind not in SPEED_KINDS:
        raise ValueError(f"kind {kind!r} is none of {', '.join(SPEED_KINDS)}")
    way = autopilot_of(state.autopilot).speed(state, checked("speed_mps", speed_mps, 0.1, 200.0), kind)
    return CommandPlan(
        "speed", way.steps, lambda _: True, MODE_TIMEOUT_S, refusal_hint=way.refusal_hint, occupies=""
    )


def reboot(state: VehicleState) -> CommandPlan:
    """Have the autopilot boot anew; done when its clock has begun again. It refuses while it is armed."""
    step = command_long(state, int(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN), 1.0)
    hint = "the UA is armed" if state.armed else ""
    return CommandPlan("reboot", (step,), lambda _: False, REBOOT_TIMEOUT_S, refusal_hint=hint, reboots=True)
