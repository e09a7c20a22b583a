"""What every autopilot is asked, and what it answers with: how it is brought to fly something."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, NoReturn

from aps.vehicle.commands.plan import Step
from aps.vehicle.execution import Refusal
from aps.vehicle.flight.setpoints import Place, Yaw
from aps.vehicle.flight.steps import PREARM_CHECK, arm_step, command_long
from aps.vehicle.state import Vector3, VehicleState
from aps.wire.dialect import mavlink

SYSTEM_TIME: Final = 2
FTP: Final = 110
"""FILE_TRANSFER_PROTOCOL."""
TIMESYNC: Final = 111
LOG_LIST: Final = 117
"""LOG_REQUEST_LIST."""
LOG_DATA: Final = 119
"""LOG_REQUEST_DATA."""


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """How an autopilot is brought to fly something."""

    steps: tuple[Step, ...] = ()
    modes: tuple[str, ...] = ()
    """The modes that it flies it in."""
    last_modes: tuple[str, ...] = ()
    """Of a mission: the modes that its last item may lead to ..."""
    return_modes: tuple[str, ...] = ()
    """... and those of them that bring it home: no item is reached then, and a fixed wing circles there."""
    end_modes: tuple[str, ...] = ()
    """Of a mission: the modes that it goes on to by itself when no item is left."""
    by_setpoints: bool = False
    """Whether we fly it, by setpoints that are repeated."""
    lead_s: float | None = None
    """For how long setpoints are sent before the first step; ``None``: they begin with acceptance."""
    longest_period_s: float = math.inf
    """Between two setpoints."""
    stop_messages: Callable[[VehicleState], list[Any]] | None = None
    """What is said at the end, so that it stays where it is."""
    refusal_hint: str = ""
    """What a refusal without words may mean."""
    rejection_texts: tuple[str, ...] = ()
    """Beginnings of texts by which it refuses what it has acknowledged."""
    interruption_texts: tuple[str, ...] = ()
    """Beginnings of texts by which it goes on to something else in a mode of the same name."""
    onward_texts: tuple[str, ...] = ()
    """Beginnings of texts by which it goes on by itself in a mode of ``onward_modes``, as a part of it."""
    onward_modes: tuple[str, ...] = ()
    after_circle: tuple[Step, ...] = ()
    """Steps that come first after a circle of ours, whose radius it would keep."""
    silent_refusal: str = ""
    """Why it may drop a point of ours in silence; empty where it takes all."""
    keeps_speed: bool = True
    """Whether points are flown at a speed that is asked for."""


@dataclass(frozen=True, slots=True)
class Target:
    """A point to fly to and stay at."""

    place: Place
    frame: str = "relative"
    """What its height counts from: ``relative`` home, ``amsl`` mean sea level, ``terrain`` the ground below."""
    speed_mps: float | None = None
    yaw_deg: float | None = None


@dataclass(frozen=True, slots=True)
class Circle:
    """A circle to fly, its centre's height above home."""

    centre: Place
    radius_m: float
    speed_mps: float
    clockwise: bool


class FlightStack:
    """What MAVLink alone says of an autopilot: it is listened to, armed and given missions and parameters.

    What takes a mode of its own is refused. Those of which more is known differ in what they override. It keeps
    nothing: what it answers follows from the state. Where it cannot do what is asked it raises ``Refusal``, with the
    reason in words.
    """

    name = "another autopilot"
    home_is_an_item = False
    """Whether home is item 0 of its missions."""
    zero_is_here = False
    """Whether an item without a place is sent with 0, 0, where it is when the item's turn comes, or needs one."""
    bytewise_parameters = False
    """Whether whole numbers are the four bytes of a PARAM_VALUE's float."""
    packed_parameters = False
    """Whether it has a file of all parameters."""
    events_path: str | None = None
    """Where it keeps what its events mean, if it has that."""
    stream_twins: Mapping[int, int | None] = {}
    """Messages that ArduPilot has -> the one of the same use here; ``None`` where there is none to ask for."""
    unrepeatable: Mapping[int, str] = {
        FTP: "a client used MAVLink FTP, which the autopilot may answer when the machine lets it",
        LOG_LIST: "a client listed logs: LOG_ENTRY may have times by the machine's clock",
        LOG_DATA: "a client downloaded a log, which the autopilot may read when the machine lets it",
    }
    """By id of a client's message: why a simulated flight may not repeat once it was sent, since the answer depends on
    the machine's threads or clock."""
    unrepeatable_answers: Mapping[int, str] = {}
    """The same by id of a message that the autopilot sends if asked to; of TIMESYNC those that answer one."""
    mode_aliases: Mapping[str, str] = {}
    """Names that are taken for modes of its own."""

    def modes(self, vehicle_type: int) -> Mapping[str, int]:  # noqa: ARG002
        """Mode name -> ``custom_mode`` of a MAV_TYPE; empty where none are known."""
        return {}

    def mode_step(self, state: VehicleState, mode: str) -> Step:
        """Into a mode of ``modes``."""
        _refuse(state, f"mode {mode}")

    def stick_mode(self, state: VehicleState, mode: str) -> str:  # noqa: ARG002
        """The mode, if it climbs and sinks by a throttle stick that is at zero where there is no receiver."""
        return ""

    def last_item(self, total: int, mission_state: int) -> int:
        """Number of a mission's last item by MISSION_CURRENT; -1 where that does not say.

        Both fields are extensions: 0 where they are not sent.
        """
        return total if mission_state else -1

    def ready_to_arm(self, enabled: int, health: int) -> bool:
        """By SYS_STATUS's sensors that are enabled and healthy (MAV_SYS_STATUS_SENSOR); checks may be switched off."""
        return not enabled & PREARM_CHECK or bool(health & PREARM_CHECK)

    def is_guess(self, lat_e7: int, lon_e7: int, alt_mm: int, alt_rel_mm: int) -> bool:  # noqa: ARG002
        """Whether it may have no place yet though it sends one: it has told neither a home nor that it is sure."""
        return False

    def takeoff(self, state: VehicleState, height_m: float) -> Manoeuvre:  # noqa: ARG002
        """To a height above home."""
        _refuse(state, "takeoff")

    def hold(self, state: VehicleState) -> Manoeuvre:
        """Stay here."""
        _refuse(state, "hold")

    def goto(self, state: VehicleState, target: Target) -> Manoeuvre:  # noqa: ARG002
        """To a point."""
        _refuse(state, "goto")

    def setpoints(self, state: VehicleState, verb: str) -> Manoeuvre:
        """Follow setpoints, for a command of this name."""
        _refuse(state, verb)

    def stay_at(self, state: VehicleState, goal_ned_m: Vector3, yaw: Yaw) -> list[Any]:  # noqa: ARG002
        """What is said when a point in local metres is reached, so that it stays there."""
        return []

    def global_setpoint(self, state: VehicleState, place: Place, velocity_mps: Vector3, yaw: Yaw) -> Any:  # noqa: ARG002
        """A place, its height above home, and a velocity to have there."""
        _refuse(state, "a setpoint")

    def orbit(self, state: VehicleState, circle: Circle) -> Manoeuvre:  # noqa: ARG002
        """Circle a point."""
        _refuse(state, "orbit")

    def rtl(self, state: VehicleState) -> Manoeuvre:
        """Return to launch."""
        _refuse(state, "rtl")

    def land(self, state: VehicleState) -> Manoeuvre:
        """Land."""
        _refuse(state, "land")

    def mission(self, state: VehicleState) -> Manoeuvre:
        """Fly the mission."""
        _refuse(state, "mission")

    def current_item_step(self, state: VehicleState, seq: int) -> Step:
        """Go on with another item of the mission."""
        return command_long(state, int(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT), float(seq), 0.0)

    def arm(self, state: VehicleState) -> Manoeuvre:
        """Arm the motors."""
        return Manoeuvre((arm_step(state),))

    def speed(self, state: VehicleState, speed_mps: float, kind: str) -> Manoeuvre:  # noqa: ARG002
        """Change the speed; ``kind`` is one of ``air``, ``ground``, ``climb``, ``descent``."""
        _refuse(state, "speed")


def _refuse(state: VehicleState, what: str) -> NoReturn:
    raise Refusal(f"{what} is known of ArduPilot and PX4 alone, and MAV_AUTOPILOT is {state.autopilot}")
