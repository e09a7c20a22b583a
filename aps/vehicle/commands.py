"""One command to the autopilot from request to result: acknowledgement, retry, feedback. No I/O, no clock.

A ``CommandPlan`` (see ``plans``) says what to send and when the goal is reached; a ``CommandExecution`` carries it
through. Its owner calls ``poll`` whenever something has happened or the deadline has passed, sends the
messages that come back and looks at ``events`` and ``result``.

Two clocks: acknowledgements and retries run on the daemon's (``now_ns``: wall time, or sim time in held
mode), since the link does; the time a flight may take runs on the autopilot's own
(``VehicleState.time_boot_ms``), since a simulation may be paused, slow or fast. How long that one may stand
still is again a matter of the daemon's: see ``timeouts``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from aps.timeouts import (
    ACK_TIMEOUTS_S,
    ARMED_GRACE_MS,
    FEEDBACK_PERIOD_MS,
    IN_PROGRESS_TIMEOUT_S,
    MODE_TIMEOUT_S,
    REASON_GRACE_S,
    SHOWN_LAG_S,
    SHOWN_TIMEOUT_S,
    SILENCE_TIMEOUT_S,
)
from aps.vehicle.execution import NS_PER_S, CommandProgress, CommandResult, Execution, Outcome
from aps.vehicle.state import VehicleState
from aps.vehicle.status_text import StatusText
from aps.wire.dialect import enum_label, mavlink, message_class

__all__ = [
    "CommandExecution",
    "CommandPlan",
    "CommandProgress",
    "CommandResult",
    "Echo",
    "Outcome",
    "Step",
    "reasons",
]

PARAMETER_TOLERANCE: Final = 1.0
LEAD_PATIENCE: Final = 10.0
"""Leads that are waited for by our clock, if the autopilot's is slower."""
FLIGHT: Final = "flight"
ARMING: Final = "arming"
NO_LINK: Final = "no link to the autopilot"
NOT_ARMED: Final = "the UA is not armed"
MAX_REASON_SEVERITY: Final = int(mavlink.MAV_SEVERITY_WARNING)

_HEARTBEAT: Final = 0
_PARAM_VALUE: Final = 22
_ACCEPTED: Final = int(mavlink.MAV_RESULT_ACCEPTED)
_IN_PROGRESS: Final = int(mavlink.MAV_RESULT_IN_PROGRESS)
_NOT_NOW: Final = int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
AGAIN_S: Final = 0.25
"""After so long a step that was rejected for now is sent again."""
ECHO_SETPOINTS: Final = 5
"""So many setpoints in a row do not get lost."""
MOST_ECHOES: Final = 10
"""That are asked for: it may have no such message."""


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
    """What a command sends and when it is done."""

    verb: str
    steps: tuple[Step, ...]
    reached: Callable[[VehicleState], bool]
    timeout_s: float
    """Autopilot time allowed between acceptance and the goal."""
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
    remark: str = ""
    """Said with the acceptance."""
    stick_mode: str = ""
    """Mode that it leaves the UA in, if that one climbs and sinks by the throttle stick."""


@dataclass(slots=True)
class _Waiting:
    """For the acknowledgement of one step."""

    tries: int = 0
    deadline_ns: int = 0
    answer: int | None = None
    """MAV_RESULT, once it is there."""
    in_progress: bool = False
    refused_ns: int | None = None
    rejected_ns: int | None = None
    """When it was first rejected for now."""
    acknowledged_ns: int | None = None
    """When it was accepted, of a step that has yet to be shown."""
    texts: list[str] = field(default_factory=list)


class CommandExecution(Execution):
    """Carries out one plan.

    Args:
        plan: what to do.
        silence_s: for how long, by the daemon's clock, the autopilot's may stand still after acceptance.
    """

    def __init__(self, plan: CommandPlan, silence_s: float = SILENCE_TIMEOUT_S) -> None:
        super().__init__(plan.verb, plan.occupies)
        self.plan = plan
        if any(step.parameter for step in plan.steps):
            self.wanted = frozenset({_PARAM_VALUE})
        if plan.echo is not None:
            self.wanted |= {int(message_class(plan.echo.name).id)}
        self._step = 0
        self._waiting = _Waiting()
        self._accepted_ms: int | None = None
        self._accepted_ns = 0
        self._mode_before: str | None = None
        """The mode when it began."""
        self._lead: tuple[int, int] | None = None
        """The autopilot's clock, ms, and ours, ns, since when it has had setpoints, ours or of those before us."""
        self._begun_ms: int | None = None
        """The autopilot's clock at our own first one, where that is before acceptance."""
        self._setpoint_ns = 0
        self._setpoint_ms = 0
        self._besides = 0
        """How often it had something beside a setpoint."""
        self._echoes = 0
        """How often it was asked what it flies to ..."""
        self._taken = False
        """... whether it said that it is what it was sent ..."""
        self._other: Mapping[str, Any] | None = None
        """... or what else, in the end."""
        self._feedback_ms = 0
        self._mode_seen = False
        self._armed_seen = False
        self._left_ms: int | None = None
        self._rejection = ""
        self._said_before: list[str] = []
        """What may be the reason of a refusal to which nothing is said: of tries before, or of what led up to it."""
        self._silence_ns = round(silence_s * NS_PER_S)
        self._clock_ms = 0
        self._clock_ns = 0
        """When the autopilot's clock was first seen to be what it is now."""

    @property
    def request(self) -> object | None:
        """What waits for an acknowledgement: the same object for all tries of one step."""
        return self._waiting if self._accepted_ms is None else None

    # What happens.

    def on_ack(self, command: int, result: int, progress: int = 0xFF) -> None:
        """COMMAND_ACK addressed to us. One that answers nothing we wait for is ignored."""
        if self._waits() and self.plan.steps[self._step].command == command:
            if result == _IN_PROGRESS:
                self._waiting.in_progress = True
                share = "" if progress == 0xFF else f", {progress} %"
                self.tell("feedback", f"in progress{share}")
            else:
                self._waiting.answer = result

    def on_parameter(self, name: str, value: float) -> None:
        """PARAM_VALUE of the autopilot; also one that somebody else has asked for."""
        if self._waits():
            step = self.plan.steps[self._step]
            if step.parameter == name and abs(value - step.value) <= PARAMETER_TOLERANCE:
                self._waiting.answer = _ACCEPTED

    def _waits(self) -> bool:
        return self.result is None and self._accepted_ms is None and self._waiting.answer is None

    def on_text(self, text: StatusText) -> None:
        """STATUSTEXT of the autopilot: a refusal's reason, or an interruption's."""
        if _may_be_a_reason(text) and text.text not in self._waiting.texts:
            self._waiting.texts.append(text.text)
        if text.text.startswith(self.plan.rejection_texts):
            self._rejection = text.text

    def follows(self, texts: Iterable[StatusText]) -> None:
        """What the autopilot has said to that which led up to this command, e.g. to the upload of a mission."""
        self._said_before = reasons(texts)

    def on_message(self, name: str, fields: Mapping[str, Any], now_ns: int) -> None:  # noqa: ARG002
        """PARAM_VALUE of the autopilot, or what it says that it flies to."""
        if name == "PARAM_VALUE":
            self.on_parameter(fields["param_id"], fields["param_value"])
        echo = self.plan.echo
        if echo is not None and echo.name == name and self._echoes:
            self._taken |= echo.is_ours(fields)
            self._other = None if self._taken or self._echoes < ECHO_SETPOINTS else fields

    def on_link(self, connected: bool, now_ns: int) -> None:
        """What has not been accepted ends with the link: sent when that is back, it would surprise (motors that spin).

        What has been accepted goes on in flight, and waits for the link, as does what asks for a reboot.
        """
        super().on_link(connected, now_ns)
        if not connected and self._accepted_ms is None and not self.plan.reboots:
            self.interrupt(NO_LINK)

    def on_reboot(self) -> None:
        """The autopilot has rebooted, as it was asked to or of itself."""
        if self.plan.reboots:
            self.end(Outcome.REACHED)
        else:
            super().on_reboot()

    def leads_on(self, older: CommandExecution) -> None:
        """Take the place of another whose setpoints the autopilot has had until now."""
        if self.plan.lead_s is not None and older.plan.lead_s is not None:
            self._lead = older._lead

    def leave_speed(self) -> None:
        """Ask for its speed no more: a newer command changes it."""
        self._besides = ECHO_SETPOINTS

    def _poll(self, state: VehicleState, now_ns: int) -> list[Any]:
        if self._mode_before is None:
            self._mode_before = state.mode
        if self._accepted_ms is not None:
            return [*self._poll_goal(state, now_ns), *self._poll_setpoint(state, now_ns)]
        if self.plan.lead_s is not None:
            leads = self._leads(state, now_ns, self.plan.lead_s)
            setpoints = self._poll_setpoint(state, now_ns)
            return setpoints if leads else [*setpoints, *self._poll_steps(state, now_ns)]
        messages = self._poll_steps(state, now_ns)
        return messages if self._accepted_ms is None else [*messages, *self._poll_setpoint(state, now_ns)]

    def _leads(self, state: VehicleState, now_ns: int, lead_s: float) -> bool:
        """Whether it is too early for the first step; an autopilot whose clock stands still is not waited for."""
        if self._begun_ms is None:
            self._begun_ms = state.time_boot_ms
        if self._lead is None:
            self._lead = state.time_boot_ms, now_ns
        from_ms, from_ns = self._lead
        waits = now_ns - from_ns < LEAD_PATIENCE * lead_s * NS_PER_S
        return waits and state.time_boot_ms - from_ms < lead_s * 1000.0

    def _due_ns(self) -> int | None:
        if self._accepted_ms is None:
            waiting = self._waiting
            due_ns = waiting.deadline_ns if waiting.refused_ns is None else self._reason_due_ns()
            if self.plan.lead_s is None:
                return due_ns
            return min(due_ns, self._setpoint_ns) if waiting.tries else self._setpoint_ns
        due_ns = self._clock_ns + self._silence_ns
        return due_ns if self.plan.setpoint is None else min(due_ns, self._setpoint_ns)

    # Steps and their acknowledgements.

    def _poll_steps(self, state: VehicleState, now_ns: int) -> list[Any]:
        done = None if not self.plan.steps else self.plan.steps[self._step].done
        if done is not None and self._waiting.tries and done(state):
            self._waiting.answer = _ACCEPTED
        if self._is_yet_to_be_shown(state, now_ns):
            return []
        while self._waiting.answer == _ACCEPTED or not self.plan.steps:
            if not self._next_step(state, now_ns):
                return self._poll_goal(state, now_ns)
        if self._tries_again(now_ns):
            return []
        if self._waiting.answer is not None:
            self._refused(self._waiting.answer, now_ns)
            return self._poll_steps(state, now_ns) if self._waiting.answer == _ACCEPTED else []
        if now_ns < self._waiting.deadline_ns:
            if self._waiting.in_progress:
                self._waiting.deadline_ns = now_ns + round(IN_PROGRESS_TIMEOUT_S * NS_PER_S)
                self._waiting.tries = len(ACK_TIMEOUTS_S)
                self._waiting.in_progress = False
            return []
        return self._send_step(now_ns)

    def _next_step(self, state: VehicleState, now_ns: int) -> bool:
        """Go on to the next step; False when there is none and the flight towards the goal begins."""
        explained = self._step < len(self.plan.steps) and self.plan.steps[self._step].explains
        self._step += 1
        self._waiting = _Waiting(texts=self._waiting.texts if explained else [])
        if self._step < len(self.plan.steps):
            return True
        self._accepted_ms = self._feedback_ms = state.time_boot_ms
        self._accepted_ns = now_ns
        self._setpoint_ns = now_ns
        self.tell("accepted", ": ".join(filter(None, ("accepted by the autopilot", self.plan.remark))))
        self._clock_ns = now_ns
        return False

    def _send_step(self, now_ns: int) -> list[Any]:
        waiting = self._waiting
        if waiting.tries >= len(ACK_TIMEOUTS_S):
            self.end(Outcome.TIMED_OUT, f"no acknowledgement after {waiting.tries} tries")
            return []
        message = self.plan.steps[self._step].message(waiting.tries)
        waiting.deadline_ns = now_ns + round(ACK_TIMEOUTS_S[waiting.tries] * NS_PER_S)
        waiting.tries += 1
        return [message]

    def _is_yet_to_be_shown(self, state: VehicleState, now_ns: int) -> bool:
        """Whether what was acknowledged may still be seen to be done; where it is not, the answer becomes a rejection.

        Where no heartbeat comes, the acknowledgement counts.
        """
        waiting = self._waiting
        if waiting.answer != _ACCEPTED or not self.plan.steps:
            return False
        shown = self.plan.steps[self._step].shown
        if shown is None or shown(state) or waiting.refused_ns is not None:
            return False
        if waiting.acknowledged_ns is None:
            waiting.acknowledged_ns = now_ns
            waiting.deadline_ns = now_ns + round(SHOWN_TIMEOUT_S * NS_PER_S)
        if state.heard_ns.get(_HEARTBEAT, 0) >= waiting.acknowledged_ns + round(SHOWN_LAG_S * NS_PER_S):
            waiting.answer, waiting.acknowledged_ns = _NOT_NOW, None
            return False
        return now_ns < waiting.deadline_ns

    def _tries_again(self, now_ns: int) -> bool:
        """Whether the step was rejected for now, and is to be sent again a little later."""
        waiting, patience_ns = self._waiting, round(self.plan.steps[self._step].patience_s * NS_PER_S)
        if waiting.answer != _NOT_NOW:
            return False
        if waiting.rejected_ns is None:
            waiting.rejected_ns = now_ns
        if now_ns - waiting.rejected_ns >= patience_ns:
            return False
        waiting.answer, waiting.in_progress, waiting.tries = None, False, 0
        waiting.deadline_ns = now_ns + round(AGAIN_S * NS_PER_S)
        self._said_before = waiting.texts or self._said_before
        waiting.texts = []
        return True

    def _refused(self, result: int, now_ns: int) -> None:
        waiting, step = self._waiting, self.plan.steps[self._step]
        if waiting.refused_ns is None:
            waiting.refused_ns = now_ns
        if not waiting.texts and now_ns < self._reason_due_ns():
            return
        words = "; ".join(waiting.texts or self._said_before)
        label = enum_label("MAV_RESULT", result)
        reason = f"{label}: {words}" if words else label
        name = enum_label("MAV_CMD", step.command or 0)
        if step.optional:
            self.tell("feedback", f"{name} refused: {reason}")
            waiting.answer = _ACCEPTED
            return
        hint = self.plan.refusal_hint or f"{name}; the autopilot does not say why"
        self.end(Outcome.REFUSED, reason if words else f"{reason} ({hint})")

    def _reason_due_ns(self) -> int:
        return (self._waiting.refused_ns or 0) + round(REASON_GRACE_S * NS_PER_S)

    # The flight towards the goal.

    def _poll_goal(self, state: VehicleState, now_ns: int) -> list[Any]:
        """Look whether the goal is reached or missed; returns what is to be said at the end."""
        plan = self.plan
        if state.time_boot_ms != self._clock_ms:
            self._clock_ms, self._clock_ns = state.time_boot_ms, now_ns
        flown_ms = state.time_boot_ms - (self._accepted_ms or 0)
        self._mode_seen |= state.mode in plan.modes or self._is_in_another_mode(state)
        self._armed_seen |= state.armed
        duration_s = plan.duration_s
        if plan.echo is not None and self._other is not None and plan.echo.is_true(self._other, state):
            self._rejection = plan.echo.refusal
        self._other = None
        if self._rejection:
            self.end(Outcome.REFUSED, self._rejection)
            return []
        is_disarmed = plan.needs_armed and not state.armed
        is_disarmed &= self._armed_seen or flown_ms >= ARMED_GRACE_MS
        is_over = duration_s is not None and flown_ms >= duration_s * 1000.0
        if plan.reached(state) or (is_over and not is_disarmed):
            self.end(Outcome.REACHED)
            return [] if plan.stop_messages is None else plan.stop_messages(state)
        if is_disarmed:
            self.end(Outcome.INTERRUPTED, NOT_ARMED + self._words())
        elif self._was_not_entered(state, flown_ms):
            self.end(
                Outcome.TIMED_OUT,
                f"accepted, but not begun within {MODE_TIMEOUT_S:g} s of autopilot time: {state.mode}"
                + self._words(),
            )
        elif self._has_left(state):
            self.end(Outcome.INTERRUPTED, f"mode changed to {state.mode}" + self._words())
        elif flown_ms > plan.timeout_s * 1000.0:
            self.end(
                Outcome.TIMED_OUT, f"not there after {plan.timeout_s:g} s of autopilot time" + self._words()
            )
        elif now_ns - self._clock_ns >= self._silence_ns:
            still_s = self._silence_ns / NS_PER_S
            self.end(Outcome.TIMED_OUT, f"the autopilot's clock has stood still for {still_s:g} s")
        elif state.time_boot_ms - self._feedback_ms >= FEEDBACK_PERIOD_MS:
            self._feedback(state)
        return []

    def _was_not_entered(self, state: VehicleState, flown_ms: int) -> bool:
        """Whether what was acknowledged too early has not come about since."""
        shown = self.plan.steps[-1].shown if self.plan.steps else None
        self._mode_seen |= shown is not None and shown(state)
        is_told = shown is not None or (bool(self.plan.modes) and self._heartbeat_since(state))
        return is_told and not self._mode_seen and flown_ms > MODE_TIMEOUT_S * 1000.0

    def _is_in_another_mode(self, state: VehicleState) -> bool:
        """Whether a heartbeat from after the acceptance shows another mode than before: ours, or one that followed."""
        return state.mode != self._mode_before and self._heartbeat_since(state)

    def _heartbeat_since(self, state: VehicleState) -> bool:
        """Whether a heartbeat came after the acceptance."""
        return state.heard_ns.get(_HEARTBEAT, 0) >= self._accepted_ns + round(SHOWN_LAG_S * NS_PER_S)

    def _has_left(self, state: VehicleState) -> bool:
        """Whether it flies in another mode: in one that may be a part of the plan, after some time of it."""
        plan = self.plan
        outside = self._mode_seen and plan.modes and state.mode not in plan.modes
        if not outside or plan.may_leave(state):
            self._left_ms = None
            return False
        if self._left_ms is None:
            self._left_ms = state.time_boot_ms
        return state.time_boot_ms - self._left_ms >= plan.leave_grace_ms

    def _feedback(self, state: VehicleState) -> None:
        self._feedback_ms = state.time_boot_ms
        text, done, total = f"{state.mode}, {state.alt_rel_m:.1f} m above home", None, None
        if self.plan.position is not None:
            done, total = self.plan.position(state)
            text += f", item {done}" + ("" if total is None else f" of {total}")
        remaining_m = self.plan.remaining_m(state)
        text += "" if remaining_m is None else f", {remaining_m:.1f} m to go"
        self.tell("feedback", text, remaining_m=remaining_m, done=done, total=total)

    def _poll_setpoint(self, state: VehicleState, now_ns: int) -> list[Any]:
        """The setpoint, if it is due by the daemon's clock or by the autopilot's, which may run faster."""
        plan, clock_ms = self.plan, state.time_boot_ms
        if plan.setpoint is None or self.result is not None:
            return []
        if now_ns < self._setpoint_ns and clock_ms < self._setpoint_ms:
            return []
        self._setpoint_ns = now_ns + round(plan.setpoint_period_s * NS_PER_S)
        self._setpoint_ms = clock_ms + round(plan.setpoint_period_s * 1000.0)
        from_ms = (self._accepted_ms or 0) if self._begun_ms is None else self._begun_ms
        messages = [plan.setpoint(state, (clock_ms - from_ms) / 1000.0)]
        if plan.beside is not None and self._accepted_ms is not None and self._besides < ECHO_SETPOINTS:
            self._besides += 1
            messages.append(plan.beside)
        if plan.echo is not None and not self._taken and self._echoes < MOST_ECHOES:
            self._echoes += 1
            messages.append(plan.echo.ask)
        return messages

    def _words(self) -> str:
        return f" ({self._waiting.texts[-1]})" if self._waiting.texts else ""


def reasons(texts: Iterable[StatusText]) -> list[str]:
    """Those that may be one, each once."""
    return list(dict.fromkeys(text.text for text in texts if _may_be_a_reason(text)))


def _may_be_a_reason(text: StatusText) -> bool:
    """A warning, or ArduPilot's notice of what it then does: ``Polygon fence breached``, ``changing mode to RTL``."""
    words = text.text.lower()
    is_breach = "fence" in words and words.endswith("breached")
    return text.severity <= MAX_REASON_SEVERITY or is_breach or "changing mode to" in words
