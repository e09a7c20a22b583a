"""ArduPilot: targets, setpoints and take-off in GUIDED, heights above home, home as item 0 of a mission."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any, Final

from aps.vehicle.autopilots.autopilot import FTP, LOG_DATA, LOG_LIST, Circle, FlightStack, Manoeuvre, Target
from aps.vehicle.commands.plan import Step
from aps.vehicle.execution import Refusal
from aps.vehicle.flight.setpoints import ZERO, Place, Yaw, global_setpoint, local_setpoint
from aps.vehicle.flight.steps import (
    command_int,
    command_long,
    is_fixed_wing,
    optional,
    parameter_step,
    set_mode,
)
from aps.vehicle.state import FLYING, Vector3, VehicleState
from aps.wire.dialect import is_copter, is_ground, is_plane, mavlink

STICK_MODES: Final = frozenset({"ALT_HOLD", "CIRCLE", "FLOWHOLD", "LOITER", "POSHOLD", "SPORT", "ZIGZAG"})
"""ArduCopter's modes in which the throttle stick gives the climb rate: none in the middle, full sinking at zero."""
VTOL_STICK_MODES: Final = frozenset({"QHOVER", "QLOITER"})
"""The same of ArduPlane's."""
FRAMES: Final = {
    "relative": int(mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT),
    "amsl": int(mavlink.MAV_FRAME_GLOBAL),
    "terrain": int(mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT),
}
CENTIMETRE_M: Final = 0.01
"""It keeps heights in whole ones."""
LEAST_HEIGHT_M: Final = 0.1
COUNTER_CLOCKWISE: Final = 1.0
"""For the yaw of DO_REPOSITION, by which a plane takes the way around: any but 0 and NaN."""
SPEED_TYPES: Final = {"air": 0.0, "ground": 1.0, "climb": 2.0, "descent": 3.0}
COPTER_SPEED_MODES: Final = ("AUTO", "GUIDED", "RTL")
PLANE_SPEED_MODES: Final = ("AUTO", "GUIDED")
"""In which the last DO_CHANGE_SPEED counts, and one is taken."""
PLANE_RETURN_MODES: Final = ("RTL", "QRTL")
"""A QuadPlane's RTL goes on to QRTL, or is QRTL, with some values of Q_RTL_MODE."""
STANDS_BELOW_M: Final = 2.0
"""Above home: a plane below may stand, whatever it says."""
LANDING_TEXTS: Final = ("Landing sequence start", "Landing sequence active")
"""A plane's RTL goes on to its mission's DO_LAND_START, with some values of RTL_AUTOLAND."""
NOWHERE_E7: Final = 10_000_000
"""1 degree: it does not get so far before it has a fix."""
HOME_AT_ZERO_MM: Final = 20
"""Between its two heights, where home is at 0 m: they are rounded apart."""
BEYOND_SPEEDS: Final = "a speed beyond AIRSPEED_MIN to AIRSPEED_MAX"
BEYOND_FENCE: Final = "ArduCopter flies to no point beyond its fence, and does not say so"
_SPELLING: Final = {
    "FLY_BY_WIRE_A": "FBWA",
    "FLY_BY_WIRE_B": "FBWB",
    "INITIALIZING": "INITIALISING",
    "LOITER_ALT_QLAND": "LOITERALTQLAND",
}
"""The enum's spelling -> the one that ground stations and ArduPilot's own documentation use."""


def _mode_enum(vehicle_type: int) -> str:
    if is_copter(vehicle_type):
        return "COPTER_MODE"
    if is_plane(vehicle_type):
        return "PLANE_MODE"
    if is_ground(vehicle_type):
        return "ROVER_MODE"
    return "SUB_MODE" if vehicle_type == mavlink.MAV_TYPE_SUBMARINE else ""


@cache
def _modes(vehicle_type: int) -> dict[str, int]:
    enum = _mode_enum(vehicle_type)
    entries = mavlink.enums[enum].items() if enum else ()
    labels = {entry.name.removeprefix(enum + "_"): int(number) for number, entry in entries}
    return {_SPELLING.get(label, label): number for label, number in labels.items() if label != "ENUM_END"}


def stop(state: VehicleState) -> list[Any]:
    """Have a copter stop where it is."""
    return [local_setpoint(state, mavlink.MAV_FRAME_LOCAL_NED, None, ZERO, Yaw())]


class ArduPilotStack(FlightStack):
    """ArduCopter, ArduPlane, Rover and Sub."""

    name = "ArduPilot"
    home_is_an_item = True
    zero_is_here = True
    packed_parameters = True
    unrepeatable: Mapping[int, str] = {
        FTP: "a client used MAVLink FTP, which ArduPilot answers from a thread of its own",
        LOG_LIST: "a client listed logs: LOG_ENTRY of ArduPilot has the times of files, by the machine's clock, and "
        "how much a thread has written of the one that is open",
        LOG_DATA: "a client downloaded a log, which ArduPilot reads in a thread of its own",
    }

    def modes(self, vehicle_type: int) -> Mapping[str, int]:
        """By vehicle."""
        return _modes(vehicle_type)

    def mode_step(self, state: VehicleState, mode: str) -> Step:
        """DO_SET_MODE with ``custom_mode``.

        Raises:
            Refusal: vehicles of this type have no such mode.
        """
        if mode not in (modes := _modes(state.vehicle_type)):
            raise Refusal(f"{self.name} has no mode {mode} for vehicles of MAV_TYPE {state.vehicle_type}")
        return set_mode(state, modes[mode])

    def stick_mode(self, state: VehicleState, mode: str) -> str:
        """Some of ArduCopter's, and those of a QuadPlane that hold a height."""
        if is_plane(state.vehicle_type):
            return mode if mode in VTOL_STICK_MODES else ""
        return mode if mode in STICK_MODES and is_copter(state.vehicle_type) else ""

    def is_guess(self, lat_e7: int, lon_e7: int, alt_mm: int, alt_rel_mm: int) -> bool:
        """It reckons from 0 N 0 E before it has a fix, and from a height of 0 m before it has a home (AP_AHRS_DCM)."""
        at_nowhere = abs(lat_e7) < NOWHERE_E7 and abs(lon_e7) < NOWHERE_E7
        return at_nowhere or abs(alt_mm - alt_rel_mm) <= HOME_AT_ZERO_MM

    def takeoff(self, state: VehicleState, height_m: float) -> Manoeuvre:
        """Copters and VTOL: GUIDED and NAV_TAKEOFF. Fixed wing: the TAKEOFF mode with TKOFF_ALT set.

        Raises:
            Refusal: it flies. ArduPilot would say so to NAV_TAKEOFF alone, after the mode has changed.
        """
        if state.armed and _flies(state):
            raise Refusal("it flies already")
        hint = "" if state.armed else "the UA is not armed"
        if is_fixed_wing(state):
            steps = (parameter_step(state, "TKOFF_ALT", height_m), self.mode_step(state, "TAKEOFF"))
            return Manoeuvre(steps, ("TAKEOFF",), refusal_hint=hint)
        climb = command_long(state, int(mavlink.MAV_CMD_NAV_TAKEOFF), *[0.0] * 6, height_m)
        steps = (self.mode_step(state, "GUIDED"), climb)
        return Manoeuvre(steps, ("GUIDED",), refusal_hint=hint)

    def hold(self, state: VehicleState) -> Manoeuvre:
        """A copter stops in GUIDED, where it needs no pilot; a plane circles in LOITER."""
        if is_plane(state.vehicle_type):
            return Manoeuvre((self.mode_step(state, "LOITER"),), ("LOITER",))
        return self._in_guided(state)

    def _in_guided(self, state: VehicleState) -> Manoeuvre:
        steps = () if state.mode == "GUIDED" else (self.mode_step(state, "GUIDED"),)
        return Manoeuvre(steps, ("GUIDED",), by_setpoints=True, stop_messages=stop)

    def goto(self, state: VehicleState, target: Target) -> Manoeuvre:
        """DO_REPOSITION in GUIDED, then speed and heading."""
        steps = [self.mode_step(state, "GUIDED"), _reposition(state, FRAMES[target.frame], target.place)]
        if target.speed_mps is not None:
            kind, why = ("air", BEYOND_SPEEDS) if is_plane(state.vehicle_type) else ("ground", "")
            steps.append(optional(_speed_step(state, target.speed_mps, kind), why))
        if target.yaw_deg is not None:
            yaw = command_long(state, int(mavlink.MAV_CMD_CONDITION_YAW), target.yaw_deg % 360.0)
            steps.append(optional(yaw))
        hint = "no position yet, a point beyond its fence, or a height over terrain that it has no data of"
        if target.frame != "amsl" and abs(target.place[2]) < CENTIMETRE_M:
            hint = f"ArduPilot takes a height of 0 for the present one, and denies that; {LEAST_HEIGHT_M} m is one"
        # A plane's GUIDED keeps the radius of a circle until it is left.
        stays = is_plane(state.vehicle_type) and state.mode == "GUIDED"
        leaving = (self.mode_step(state, "LOITER"),) if stays else ()
        return Manoeuvre(tuple(steps), ("GUIDED",), refusal_hint=hint, after_circle=leaving)

    def setpoints(self, state: VehicleState, verb: str) -> Manoeuvre:
        """In GUIDED."""
        if is_plane(state.vehicle_type):
            raise Refusal(
                f"ArduPlane takes no setpoints of this kind: {verb} is for copters, rovers and boats"
            )
        silent = BEYOND_FENCE if is_copter(state.vehicle_type) else ""
        return replace(self._in_guided(state), silent_refusal=silent)

    def global_setpoint(self, state: VehicleState, place: Place, velocity_mps: Vector3, yaw: Yaw) -> Any:
        """With its height above home."""
        frame = int(mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
        return global_setpoint(state, frame, place, velocity_mps, yaw)

    def orbit(self, state: VehicleState, circle: Circle) -> Manoeuvre:
        """A copter by setpoints on the circle; a plane by DO_REPOSITION with a radius."""
        if not is_plane(state.vehicle_type):
            return self._in_guided(state)
        reposition = _reposition(state, FRAMES["relative"], circle.centre, circle.radius_m, circle.clockwise)
        return Manoeuvre((self.mode_step(state, "GUIDED"), reposition), ("GUIDED",))

    def rtl(self, state: VehicleState) -> Manoeuvre:
        """RTL."""
        step = self.mode_step(state, "RTL")
        if not is_plane(state.vehicle_type):
            return Manoeuvre((step,), ("RTL",))
        return Manoeuvre((step,), PLANE_RETURN_MODES, onward_texts=LANDING_TEXTS, onward_modes=("AUTO",))

    def land(self, state: VehicleState) -> Manoeuvre:
        """A copter where it is (LAND), VTOL likewise (QLAND), a fixed wing by AUTOLAND."""
        mode = "LAND"
        if is_plane(state.vehicle_type):
            mode = "AUTOLAND" if is_fixed_wing(state) else "QLAND"
        return Manoeuvre((self.mode_step(state, mode),), (mode,))

    def mission(self, state: VehicleState) -> Manoeuvre:
        """AUTO, and MISSION_START. ArduPlane's last item that returns is another mode, a copter's a part of AUTO."""
        start = optional(command_long(state, int(mavlink.MAV_CMD_MISSION_START)))
        last = PLANE_RETURN_MODES if is_plane(state.vehicle_type) else ()
        return Manoeuvre(
            (self.mode_step(state, "AUTO"), start), ("AUTO",), last_modes=last, return_modes=last
        )

    def speed(self, state: VehicleState, speed_mps: float, kind: str) -> Manoeuvre:
        """DO_CHANGE_SPEED."""
        hint = ""
        if is_plane(state.vehicle_type):
            hint = _why_no_plane_speed(state, kind)
        elif is_copter(state.vehicle_type) and state.mode not in COPTER_SPEED_MODES:
            hint = f"ArduCopter takes speeds in {', '.join(COPTER_SPEED_MODES)}, and flies {state.mode}"
        return Manoeuvre((_speed_step(state, speed_mps, kind),), refusal_hint=hint)


def _flies(state: VehicleState) -> bool:
    """Whether it does. Of a QuadPlane that stands armed in QLOITER or QHOVER ArduPlane says so, too."""
    stands = is_plane(state.vehicle_type) and not state.alt_rel_m > STANDS_BELOW_M
    return state.landed_state in FLYING and not stands


def _reposition(
    state: VehicleState, frame: int, place: Place, radius_m: float = 0.0, clockwise: bool = True
) -> Step:
    """DO_REPOSITION; a plane circles with ``radius_m``, 0 as it is set. ArduPlane passes over a negative one."""
    flags = float(mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE)
    params = (-1.0, flags, radius_m, math.nan if clockwise else COUNTER_CLOCKWISE)
    return command_int(state, int(mavlink.MAV_CMD_DO_REPOSITION), frame, params, place)


def _speed_step(state: VehicleState, speed_mps: float, kind: str) -> Step:
    """DO_CHANGE_SPEED."""
    command = int(mavlink.MAV_CMD_DO_CHANGE_SPEED)
    return command_long(state, command, SPEED_TYPES[kind], speed_mps, -1.0)


def _why_no_plane_speed(state: VehicleState, kind: str) -> str:
    if kind in ("climb", "descent"):
        return f"ArduPlane changes no {kind} speed on the way"
    if state.mode not in PLANE_SPEED_MODES:
        return f"ArduPlane takes speeds in {', '.join(PLANE_SPEED_MODES)}, and flies {state.mode}"
    return BEYOND_SPEEDS
