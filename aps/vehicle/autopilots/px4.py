"""PX4: targets in AUTO.LOITER, setpoints in OFFBOARD, heights above mean sea level, whole numbers as bytes.

What differs is as its source has it (commander, navigator, mavlink_receiver) and was seen in flight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from aps.vehicle.autopilots.autopilot import (
    LOG_LIST,
    SYSTEM_TIME,
    TIMESYNC,
    Circle,
    FlightStack,
    Manoeuvre,
    Target,
)
from aps.vehicle.commands.plan import Step
from aps.vehicle.events import METADATA_PATH
from aps.vehicle.execution import Refusal
from aps.vehicle.flight.setpoints import Place, Yaw, global_setpoint, offset_deg
from aps.vehicle.flight.steps import PREARM_CHECK, arm_step, command_int, command_long, set_mode
from aps.vehicle.missions.reached import reached_since
from aps.vehicle.state import FLYING, Vector3, VehicleState
from aps.wire.dialect import AUTOPILOT_COMPID, is_plane, mavlink

OFFBOARD_LEAD_S: Final = 0.5
"""Setpoints have to come before OFFBOARD is entered: its checks look for one at 10 Hz."""
SETPOINT_PERIOD_S: Final = 0.25
"""It leaves OFFBOARD when none has come for COM_OF_LOSS_T, 1 s."""
HOLD: Final = "AUTO.LOITER"
BREACH_HOLDS: Final = ("Failsafe activated: switching to Hold",)
"""At a fence. In AUTO.LOITER its mode stays the same, and what it was to fly to is given up ..."""
LOSS_HOLDS: Final = ("GCS connection loss: switching to Hold", "Manual control loss: switching to Hold")
"""... for these it is not, but a take-off is."""
LANDING_ABORTS: Final = ("Landing aborted",)
"""Of a plane, which then holds above the place that it was to land at, as a mission's last item may."""
MISSION_PATIENCE_S = 1.0
"""For so long the mode of a mission is asked for again when PX4 rejects it for now."""
COMMAND_FRAME: Final = int(mavlink.MAV_FRAME_GLOBAL_INT)
"""Of COMMAND_INT. Most versions do not look at it; some of early 2026 take no other."""
NO_MISSION: Final = 0xFFFF
"""MISSION_CURRENT.total without a mission."""


def _mode(main: int, sub: int = 0) -> int:
    """Main mode and sub mode are the two high bytes of ``custom_mode`` (px4_custom_mode.h)."""
    return main << 16 | sub << 24


MODES: Final = {
    "MANUAL": _mode(1),
    "ALTCTL": _mode(2),
    "POSCTL": _mode(3),
    "ORBIT": _mode(3, 1),
    "POSCTL.SLOW": _mode(3, 2),
    "AUTO.READY": _mode(4, 1),
    "AUTO.TAKEOFF": _mode(4, 2),
    "AUTO.LOITER": _mode(4, 3),
    "AUTO.MISSION": _mode(4, 4),
    "AUTO.RTL": _mode(4, 5),
    "AUTO.LAND": _mode(4, 6),
    "AUTO.FOLLOW_TARGET": _mode(4, 8),
    "AUTO.PRECLAND": _mode(4, 9),
    "AUTO.VTOL_TAKEOFF": _mode(4, 10),
    **{f"EXTERNAL{number}": _mode(4, 10 + number) for number in range(1, 9)},
    "ACRO": _mode(5),
    "OFFBOARD": _mode(6),
    "STABILIZED": _mode(7),
    "TERMINATION": _mode(10),
}
"""Names as MAVROS and pymavlink spell them."""


class Px4Stack(FlightStack):
    """PX4 copters, fixed wings and VTOL."""

    name = "PX4"
    bytewise_parameters = True
    unrepeatable: Mapping[int, str] = {
        LOG_LIST: "a client listed logs: LOG_ENTRY of PX4 has the times of files, by the machine's clock",
    }
    unrepeatable_answers: Mapping[int, str] = {
        SYSTEM_TIME: "a client asked for SYSTEM_TIME, as with REQUEST_DATA_STREAM: that of PX4 has the machine's time",
        TIMESYNC: "a client asked for the time by TIMESYNC: in its answers PX4 leaves the ids of the target to chance",
    }
    events_path: str | None = METADATA_PATH
    stream_twins: Mapping[int, int | None] = {
        0: None,  # HEARTBEAT and
        42: None,  # MISSION_CURRENT come of themselves at 1 Hz
        62: None,  # NAV_CONTROLLER_OUTPUT: it has none
        168: 231,  # WIND: WIND_COV
        193: 230,  # EKF_STATUS_REPORT: ESTIMATOR_STATUS
    }
    mode_aliases: Mapping[str, str] = {
        "GUIDED": HOLD,
        "LOITER": HOLD,
        "BRAKE": HOLD,
        "HOLD": HOLD,
        "AUTO": "AUTO.MISSION",
        "MISSION": "AUTO.MISSION",
        "RTL": "AUTO.RTL",
        "RETURN": "AUTO.RTL",
        "LAND": "AUTO.LAND",
        "TAKEOFF": "AUTO.TAKEOFF",
        "POSITION": "POSCTL",
        "ALTITUDE": "ALTCTL",
        "STABILIZE": "STABILIZED",
    }

    def modes(self, vehicle_type: int) -> Mapping[str, int]:  # noqa: ARG002
        """The same for all vehicles."""
        return MODES

    def mode_step(self, state: VehicleState, mode: str) -> Step:
        """DO_SET_MODE with main mode and sub mode."""
        number = MODES[mode]
        return set_mode(state, number >> 16 & 0xFF, number >> 24)

    def last_item(self, total: int, mission_state: int) -> int:  # noqa: ARG002
        """It counts from 0; the state of the mission is not said by all versions."""
        return total - 1 if 0 < total < NO_MISSION else -1

    def ready_to_arm(self, enabled: int, health: int) -> bool:  # noqa: ARG002
        """It names the check among what is healthy alone."""
        return bool(health & PREARM_CHECK)

    def takeoff(self, state: VehicleState, height_m: float) -> Manoeuvre:
        """NAV_TAKEOFF here, whatever the vehicle; it holds once it is there."""
        _armed(state, "takeoff")
        if state.landed_state in FLYING:
            raise Refusal("it flies already: PX4 would take this for a height to climb to")
        nowhere = (math.nan, math.nan, _amsl_m(state, height_m))
        climb = command_long(state, int(mavlink.MAV_CMD_NAV_TAKEOFF), 0.0, 0.0, 0.0, math.nan, *nowhere)
        return Manoeuvre((climb,), ("AUTO.TAKEOFF", HOLD), interruption_texts=BREACH_HOLDS + LOSS_HOLDS)

    def hold(self, state: VehicleState) -> Manoeuvre:
        """AUTO.LOITER: a copter stops, a plane circles."""
        return Manoeuvre((self.mode_step(state, HOLD),), (HOLD,))

    def goto(self, state: VehicleState, target: Target) -> Manoeuvre:
        """DO_REPOSITION, which enters AUTO.LOITER and has speed and heading with it."""
        _armed(state, "goto")
        lat_deg, lon_deg, height_m = target.place
        if target.frame == "terrain":
            raise Refusal("PX4 takes heights above mean sea level: it knows no frame 'terrain'")
        amsl_m = height_m if target.frame == "amsl" else _amsl_m(state, height_m)
        speed_mps = -1.0 if target.speed_mps is None else target.speed_mps
        yaw_rad = math.nan if target.yaw_deg is None else math.radians(target.yaw_deg)
        step = _reposition(state, (lat_deg, lon_deg, amsl_m), speed_mps, yaw_rad)
        return Manoeuvre(
            (step,),
            (HOLD,),
            rejection_texts=("Reposition is outside geofence",),
            interruption_texts=BREACH_HOLDS,
        )

    def setpoints(self, state: VehicleState, verb: str) -> Manoeuvre:
        """In OFFBOARD, which it enters while setpoints come, and leaves when they do not come."""
        if is_plane(state.vehicle_type):
            raise Refusal(f"PX4 takes no setpoints of this kind for fixed wings: {verb} is for copters")
        return Manoeuvre(
            (self.mode_step(state, "OFFBOARD"),),
            ("OFFBOARD",),
            by_setpoints=True,
            lead_s=0.0 if state.mode == "OFFBOARD" else OFFBOARD_LEAD_S,
            longest_period_s=SETPOINT_PERIOD_S,
            stop_messages=self._stop,
            keeps_speed=False,  # in OFFBOARD as fast as MPC_XY_VEL_MAX
        )

    def _stop(self, state: VehicleState) -> list[Any]:
        return [self.mode_step(state, HOLD).message(0)]

    def stay_at(self, state: VehicleState, goal_ned_m: Vector3, yaw: Yaw) -> list[Any]:
        """AUTO.LOITER at the point itself: it is near, so the way there can be taken for flat."""
        north, east, down = (goal - now for goal, now in zip(goal_ned_m, state.position_ned_m, strict=True))
        place = (*offset_deg(state.lat_deg, state.lon_deg, north, east), state.alt_amsl_m - down)
        if not all(map(math.isfinite, place)):
            return self._stop(state)
        yaw_rad = math.nan if yaw.yaw_deg is None else math.radians(yaw.yaw_deg)
        return [_reposition(state, place, -1.0, yaw_rad).message(0)]

    def global_setpoint(self, state: VehicleState, place: Place, velocity_mps: Vector3, yaw: Yaw) -> Any:
        """Above mean sea level: with heights above home it flies wrong where home is not its origin's height."""
        lat_deg, lon_deg, height_m = place
        amsl = (lat_deg, lon_deg, _amsl_m(state, height_m))
        return global_setpoint(state, int(mavlink.MAV_FRAME_GLOBAL_INT), amsl, velocity_mps, yaw)

    def orbit(self, state: VehicleState, circle: Circle) -> Manoeuvre:
        """DO_ORBIT: a copter with its nose to the centre, a plane at its own speed."""
        _armed(state, "orbit")
        lat_deg, lon_deg, height_m = circle.centre
        signed_m = circle.radius_m if circle.clockwise else -circle.radius_m
        nose = float(mavlink.ORBIT_YAW_BEHAVIOUR_HOLD_FRONT_TO_CIRCLE_CENTER)
        params = (signed_m, circle.speed_mps, nose, 0.0)
        place = (lat_deg, lon_deg, _amsl_m(state, height_m))
        step = command_int(state, int(mavlink.MAV_CMD_DO_ORBIT), COMMAND_FRAME, params, place)
        plane = is_plane(state.vehicle_type)
        return Manoeuvre(
            (step,),
            (HOLD if plane else "ORBIT",),
            stop_messages=None if plane else self._stop,
            rejection_texts=(
                "Orbit is outside geofence",
                "Orbit radius limit exceeded",
                "Orbit command rejected",
            ),
            interruption_texts=BREACH_HOLDS,
        )

    def rtl(self, state: VehicleState) -> Manoeuvre:
        """AUTO.RTL."""
        return Manoeuvre((self.mode_step(state, "AUTO.RTL"),), ("AUTO.RTL",))

    def land(self, state: VehicleState) -> Manoeuvre:
        """AUTO.LAND, where it is."""
        return Manoeuvre((self.mode_step(state, "AUTO.LAND"),), ("AUTO.LAND",))

    def mission(self, state: VehicleState) -> Manoeuvre:
        """AUTO.MISSION: it begins by itself, where MISSION_START would arm, too.

        PX4 acknowledges a mission first, and then sees whether it can be flown: until it has, it rejects the mode. Its
        receiver has by then acknowledged that, too, in versions of July 2025 and later: the heartbeat's mode decides.
        """
        last = ("AUTO.RTL", "AUTO.LAND", "AUTO.PRECLAND", HOLD)
        begins = replace(
            self.mode_step(state, "AUTO.MISSION"),
            patience_s=MISSION_PATIENCE_S,
            shown=lambda now: _began(state, now),
        )
        return Manoeuvre(
            (begins,),
            ("AUTO.MISSION",),
            last_modes=last,
            return_modes=("AUTO.RTL",),
            end_modes=(HOLD,),
            interruption_texts=LANDING_ABORTS,
        )

    def current_item_step(self, state: VehicleState, seq: int) -> Step:
        """MISSION_SET_CURRENT, which nothing acknowledges: not all versions know the command."""

        def message(_: int) -> Any:
            return mavlink.MAVLink_mission_set_current_message(state.sysid, AUTOPILOT_COMPID, seq)

        return Step(message, done=lambda now: now.mission_current == seq)

    def arm(self, state: VehicleState) -> Manoeuvre:
        """Its checks first: by themselves they are told when they change, not when arming is refused for them."""
        checks = command_long(state, int(mavlink.MAV_CMD_RUN_PREARM_CHECKS))
        return Manoeuvre((replace(checks, optional=True, explains=True), arm_step(state)))

    def speed(self, state: VehicleState, speed_mps: float, kind: str) -> Manoeuvre:
        """DO_CHANGE_SPEED: the navigator takes any for the cruise speed."""
        if kind in ("climb", "descent"):
            raise Refusal(
                f"PX4 changes no {kind} speed on the way: see MPC_Z_VEL_MAX_UP and MPC_Z_VEL_MAX_DN"
            )
        command = int(mavlink.MAV_CMD_DO_CHANGE_SPEED)
        return Manoeuvre((command_long(state, command, 0.0 if kind == "air" else 1.0, speed_mps, -1.0),))


def _began(start: VehicleState, now: VehicleState) -> bool:
    """Whether a mission was begun, or somebody has taken over since: only a mode that stayed is asked for again.

    From AUTO.TAKEOFF it goes on to hold of itself.
    """
    stays = {start.mode, HOLD} if start.mode == "AUTO.TAKEOFF" else {start.mode}
    return now.mode == "AUTO.MISSION" or now.mode not in stays or reached_since(start, now)


def _armed(state: VehicleState, verb: str) -> None:
    """PX4 acknowledges what it then drops while it is not armed."""
    if not state.armed:
        raise Refusal(f"the UA is not armed: PX4 would acknowledge {verb}, and drop it")


def _amsl_m(state: VehicleState, height_m: float) -> float:
    """Height above mean sea level of a height above home.

    Raises:
        Refusal: where home is, is not known yet.
    """
    home_m = state.home_alt_amsl_m
    if not math.isfinite(home_m):
        home_m = state.alt_amsl_m - state.alt_rel_m
    if not math.isfinite(home_m):
        raise Refusal("PX4 takes heights above mean sea level, and where home is, is not known yet")
    return home_m + height_m


def _reposition(state: VehicleState, place: Place, speed_mps: float, yaw_rad: float) -> Step:
    """DO_REPOSITION, its height above mean sea level."""
    params = (speed_mps, float(mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE), 0.0, yaw_rad)
    return command_int(state, int(mavlink.MAV_CMD_DO_REPOSITION), COMMAND_FRAME, params, place)
