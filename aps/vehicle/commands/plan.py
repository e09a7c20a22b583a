"""What a command sends, and when it is done."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from aps.vehicle.state import VehicleState

FLIGHT: Final = "flight"
ARMING: Final = "arming"


@dataclass(frozen=True, slots=True)
class Step:
    """One message that the autopilot has to acknowledge."""

    message: Callable[[int], Any]
    """Builds the pymavlink message from the confirmation count (0, then 1, 2, ... on retries)."""
    command: int | None = None
    """MAV_CMD whose COMMAND_ACK answers it."""
    parameter: str | None = None
    """Parameter whose PARAM_VALUE answers it ..."""
    value: float = 0.0
    """... if it reports this value (to 1, since some parameters are whole numbers), not the one of before."""
    optional: bool = False
    """A refusal is reported as feedback but does not end the command."""
    hint: str = ""
    """Of an optional one: added to a refusal that came without the autopilot's words."""
    done: Callable[[VehicleState], bool] | None = None
    """Of a message that nothing acknowledges: whether the state shows that it was taken."""
    explains: bool = False
    """What the autopilot says to it are reasons for a refusal of the next step, too."""
    patience_s: float = 0.0
    """For so long it is sent again when it is rejected for now (MAV_RESULT_TEMPORARILY_REJECTED)."""
    shown: Callable[[VehicleState], bool] | None = None
    """Of a mode that is acknowledged before it is entered: whether the state shows that it was. If a later heartbeat
    does not, it counts as rejected for now; without heartbeats it has MODE_TIMEOUT_S of the autopilot's time. Of a
    mission's last step, all that shows that the mission has begun."""


@dataclass(frozen=True, slots=True)
class Echo:
    """A message in which the autopilot says what it flies to: nothing else acknowledges a setpoint."""

    name: str
    ask: Any
    """Message that asks for it, with each setpoint until one was taken."""
    is_ours: Callable[[Mapping[str, Any]], bool]
    """Whether its fields say that the setpoint was taken."""
    is_true: Callable[[Mapping[str, Any], VehicleState], bool]
    """Whether fields that say something else agree with the state."""
    refusal: str
    """What it means when it says something else after ECHO_SETPOINTS of them."""


@dataclass(frozen=True, slots=True)
class CommandPlan:
    """All of one command."""

    verb: str
    steps: tuple[Step, ...]
    reached: Callable[[VehicleState], bool]
    timeout_s: float
    """Autopilot time allowed between acceptance and the goal."""
    after_circle: tuple[Step, ...] = ()
    """Steps that come first if the flight command before was an ``orbit``."""
    remaining_m: Callable[[VehicleState], float | None] = lambda _: None
    position: Callable[[VehicleState], tuple[int, int | None]] | None = None
    """Which item of how many it is at, for feedback."""
    modes: tuple[str, ...] = ()
    """Flight modes that the command needs: leaving them interrupts the command."""
    needs_armed: bool = False
    """Being disarmed on the way interrupts it."""
    refusal_hint: str = ""
    """Added to a refusal that came without the autopilot's words."""
    occupies: str = FLIGHT
    """What of the UA it takes for itself: it takes over from the command before that takes the same."""
    target: bool = False
    """Whether it only moves the point or velocity that the UA flies to: a newer one supersedes it."""
    may_stand: bool = False
    """Whether a target can be reached on the ground, by a UA that is not armed."""
    launches: bool = False
    """Whether a UA that is not armed would keep it for later: in its mode a plane takes off as soon as it is armed."""
    setpoint: Callable[[VehicleState, float], Any] | None = None
    """Builds the message that is sent again and again from acceptance on, from the state and the seconds since."""
    setpoint_period_s: float = 0.0
    """By the autopilot's clock or the daemon's, whichever is faster."""
    beside: Any = None
    """Message that goes with the first setpoints after acceptance: a speed, which some autopilots forget as they begin
    another kind of target."""
    echo: Echo | None = None
    """How it is known that setpoints are taken, where an autopilot may drop them in silence."""
    may_leave: Callable[[VehicleState], bool] = lambda _: False
    """Whether having left them in this state is a part of it ..."""
    leave_grace_ms: int = 0
    """... and how long the rest of the state may take to show that, ms of the autopilot's clock."""
    lead_s: float | None = None
    """For how long setpoints are sent before the first step, by the autopilot's clock; ``None``: they begin with
    acceptance."""
    duration_s: float | None = None
    """Reached when so much of the autopilot's time has passed since acceptance."""
    stop_messages: Callable[[VehicleState], list[Any]] | None = None
    """What is said once the goal is reached."""
    reboots: bool = False
    """Whether a reboot is its goal."""
    rejection_texts: tuple[str, ...] = ()
    """Beginnings of texts by which the autopilot refuses what it has acknowledged."""
    interruption_texts: tuple[str, ...] = ()
    """Beginnings of texts by which it goes on to something else in one of the modes."""
    onward_texts: tuple[str, ...] = ()
    """Beginnings of texts by which it goes on by itself in one of ``onward_modes``, as a part of it."""
    onward_modes: tuple[str, ...] = ()
    remark: str = ""
    """Said with the acceptance."""
    stick_mode: str = ""
    """Mode that it leaves the UA in, if that one climbs and sinks by the throttle stick."""
