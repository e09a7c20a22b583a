"""An autopilot of which nothing is known but MAVLink itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NoReturn

from aps.vehicle.autopilots.autopilot import FTP, LOG_DATA, LOG_LIST, Circle, Manoeuvre, Target
from aps.vehicle.commands.plan import Step
from aps.vehicle.execution import Refusal
from aps.vehicle.flight.setpoints import Place, Yaw
from aps.vehicle.flight.steps import PREARM_CHECK, arm_step, command_long
from aps.vehicle.state import Vector3, VehicleState
from aps.wire.dialect import mavlink

__all__ = ["OtherStack"]


class OtherStack:
    """It is listened to, armed and given missions and parameters; what takes a mode of its own is refused."""

    name = "another autopilot"
    home_is_an_item = False
    zero_is_here = False
    bytewise_parameters = False
    packed_parameters = False
    unrepeatable: Mapping[int, str] = {
        FTP: "a client used MAVLink FTP, which the autopilot may answer when the machine lets it",
        LOG_LIST: "a client listed logs: LOG_ENTRY may have times by the machine's clock",
        LOG_DATA: "a client downloaded a log, which the autopilot may read when the machine lets it",
    }
    unrepeatable_answers: Mapping[int, str] = {}
    events_path: str | None = None
    stream_twins: Mapping[int, int | None] = {}
    mode_aliases: Mapping[str, str] = {}

    def modes(self, vehicle_type: int) -> Mapping[str, int]:  # noqa: ARG002
        """None are known."""
        return {}

    def mode_step(self, state: VehicleState, mode: str) -> Step:
        """No mode is known."""
        _refuse(state, f"mode {mode}")

    def stick_mode(self, state: VehicleState, mode: str) -> str:  # noqa: ARG002
        """None is known."""
        return ""

    def last_item(self, total: int, mission_state: int) -> int:
        """As MAVLink has it, if the extensions are sent."""
        return total if mission_state else -1

    def ready_to_arm(self, enabled: int, health: int) -> bool:
        """As MAVLink has it."""
        return not enabled & PREARM_CHECK or bool(health & PREARM_CHECK)

    def is_guess(self, lat_e7: int, lon_e7: int, alt_mm: int, alt_rel_mm: int) -> bool:  # noqa: ARG002
        """Not known of."""
        return False

    def takeoff(self, state: VehicleState, height_m: float) -> Manoeuvre:  # noqa: ARG002
        """Refused."""
        _refuse(state, "takeoff")

    def hold(self, state: VehicleState) -> Manoeuvre:
        """Refused."""
        _refuse(state, "hold")

    def goto(self, state: VehicleState, target: Target) -> Manoeuvre:  # noqa: ARG002
        """Refused."""
        _refuse(state, "goto")

    def setpoints(self, state: VehicleState, verb: str) -> Manoeuvre:
        """Refused."""
        _refuse(state, verb)

    def stay_at(self, state: VehicleState, goal_ned_m: Vector3, yaw: Yaw) -> list[Any]:  # noqa: ARG002
        """Nothing."""
        return []

    def global_setpoint(self, state: VehicleState, place: Place, velocity_mps: Vector3, yaw: Yaw) -> Any:  # noqa: ARG002
        """Refused."""
        _refuse(state, "a setpoint")

    def orbit(self, state: VehicleState, circle: Circle) -> Manoeuvre:  # noqa: ARG002
        """Refused."""
        _refuse(state, "orbit")

    def rtl(self, state: VehicleState) -> Manoeuvre:
        """Refused."""
        _refuse(state, "rtl")

    def land(self, state: VehicleState) -> Manoeuvre:
        """Refused."""
        _refuse(state, "land")

    def mission(self, state: VehicleState) -> Manoeuvre:
        """Refused."""
        _refuse(state, "mission")

    def current_item_step(self, state: VehicleState, seq: int) -> Step:
        """DO_SET_MISSION_CURRENT."""
        return command_long(state, int(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT), float(seq), 0.0)

    def arm(self, state: VehicleState) -> Manoeuvre:
        """As MAVLink has it."""
        return Manoeuvre((arm_step(state),))

    def speed(self, state: VehicleState, speed_mps: float, kind: str) -> Manoeuvre:  # noqa: ARG002
        """Refused."""
        _refuse(state, "speed")


def _refuse(state: VehicleState, what: str) -> NoReturn:
    raise Refusal(f"{what} is known of ArduPilot and PX4 alone, and MAV_AUTOPILOT is {state.autopilot}")
