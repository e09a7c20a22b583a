"""What every autopilot is asked, and what it answers with: how it is brought to fly something."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

from aps.vehicle.commands.plan import Step
from aps.vehicle.flight.setpoints import Place, Yaw
from aps.vehicle.state import Vector3, VehicleState

__all__ = [
    "FTP",
    "LOG_DATA",
    "LOG_LIST",
    "SYSTEM_TIME",
    "TIMESYNC",
    "Circle",
    "FlightStack",
    "Manoeuvre",
    "Target",
]

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


class FlightStack(Protocol):
    """One kind of flight stack. It keeps nothing: what it answers follows from the state.

    Where it cannot do what is asked it raises ``Refusal``, with the reason in words.
    """

    name: str
    home_is_an_item: bool
    """Whether home is item 0 of its missions."""
    zero_is_here: bool
    """Whether an item without a place is sent with 0, 0, where it is when the item's turn comes, or needs one."""
    bytewise_parameters: bool
    """Whether whole numbers are the four bytes of a PARAM_VALUE's float."""
    packed_parameters: bool
    """Whether it has a file of all parameters."""
    events_path: str | None
    """Where it keeps what its events mean, if it has that."""
    stream_twins: Mapping[int, int | None]
    """Messages that ArduPilot has -> the one of the same use here; ``None`` where there is none to ask for."""
    unrepeatable: Mapping[int, str]
    """By id of a client's message: why a simulated flight may not repeat once it was sent, since the answer depends on
    the machine's threads or clock."""
    unrepeatable_answers: Mapping[int, str]
    """The same by id of a message that the autopilot sends if asked to; of TIMESYNC those that answer one."""
    mode_aliases: Mapping[str, str]
    """Names that are taken for modes of its own."""

    def modes(self, vehicle_type: int) -> Mapping[str, int]:
        """Mode name -> ``custom_mode`` of a MAV_TYPE; empty where none are known."""

    def mode_step(self, state: VehicleState, mode: str) -> Step:
        """Into a mode of ``modes``."""

    def stick_mode(self, state: VehicleState, mode: str) -> str:
        """The mode, if it climbs and sinks by a throttle stick that is at zero where there is no receiver."""

    def last_item(self, total: int, mission_state: int) -> int:
        """Number of a mission's last item by MISSION_CURRENT; -1 where that does not say."""

    def ready_to_arm(self, enabled: int, health: int) -> bool:
        """By SYS_STATUS's sensors that are enabled and healthy (MAV_SYS_STATUS_SENSOR)."""

    def is_guess(self, lat_e7: int, lon_e7: int, alt_mm: int, alt_rel_mm: int) -> bool:
        """Whether it may have no place yet though it sends one: it has told neither a home nor that it is sure."""

    def takeoff(self, state: VehicleState, height_m: float) -> Manoeuvre:
        """To a height above home."""

    def hold(self, state: VehicleState) -> Manoeuvre:
        """Stay here."""

    def goto(self, state: VehicleState, target: Target) -> Manoeuvre:
        """To a point."""

    def setpoints(self, state: VehicleState, verb: str) -> Manoeuvre:
        """Follow setpoints, for a command of this name."""

    def stay_at(self, state: VehicleState, goal_ned_m: Vector3, yaw: Yaw) -> list[Any]:
        """What is said when a point in local metres is reached, so that it stays there."""

    def global_setpoint(self, state: VehicleState, place: Place, velocity_mps: Vector3, yaw: Yaw) -> Any:
        """A place, its height above home, and a velocity to have there."""

    def orbit(self, state: VehicleState, circle: Circle) -> Manoeuvre:
        """Circle a point."""

    def rtl(self, state: VehicleState) -> Manoeuvre:
        """Return to launch."""

    def land(self, state: VehicleState) -> Manoeuvre:
        """Land."""

    def mission(self, state: VehicleState) -> Manoeuvre:
        """Fly the mission."""

    def current_item_step(self, state: VehicleState, seq: int) -> Step:
        """Go on with another item of the mission."""

    def arm(self, state: VehicleState) -> Manoeuvre:
        """Arm the motors."""

    def speed(self, state: VehicleState, speed_mps: float, kind: str) -> Manoeuvre:
        """Change the speed; ``kind`` is one of ``air``, ``ground``, ``climb``, ``descent``."""
