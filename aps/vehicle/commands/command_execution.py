"""One command to the autopilot from request to result: acknowledgement, retry, feedback. No I/O, no clock.

A ``CommandPlan`` says what to send and when the goal is reached; a ``CommandExecution`` carries it through. Its owner
calls ``poll`` whenever something has happened or the deadline has passed, sends the messages that come back and looks
at ``events`` and ``result``.

Two clocks: acknowledgements and retries run on the daemon's (``now_ns``: wall time, or sim time in held
mode), since the link does; the time a flight may take runs on the autopilot's own
(``VehicleState.time_boot_ms``), since a simulation may be paused, slow or fast. How long that one may stand
still is again a matter of the daemon's: see ``timeouts``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from aps.timeouts import (
    ARMED_GRACE_MS,
    FEEDBACK_PERIOD_MS,
    MODE_TIMEOUT_S,
    ONWARD_GRACE_MS,
    SHOWN_LAG_S,
    SILENCE_TIMEOUT_S,
)
from aps.vehicle.commands.plan import CommandPlan
from aps.vehicle.commands.repeated_setpoints import RepeatedSetpoints
from aps.vehicle.commands.step_sequence import HEARTBEAT, StepSequence
from aps.vehicle.execution import NS_PER_S, Execution, Outcome
from aps.vehicle.state import VehicleState
from aps.vehicle.status_text import StatusText
from aps.wire.dialect import message_class

NO_LINK: Final = "no link to the autopilot"
NOT_ARMED: Final = "the UA is not armed"

_PARAM_VALUE: Final = 22


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
        self.steps = StepSequence(plan, self)
        self.setpoints = RepeatedSetpoints(plan)
        self._accepted_ms: int | None = None
        self._accepted_ns = 0
        self._mode_before: str | None = None
        """The mode when it began."""
        self._feedback_ms = 0
        self._mode_seen = False
        self._armed_seen = False
        self._left_ms: int | None = None
        self._rejection = self._interruption = ""
        self._goes_on = False
        self._silence_ns = round(silence_s * NS_PER_S)
        self._clock_ms = 0
        self._clock_ns = 0
        """When the autopilot's clock was first seen to be what it is now."""

    @property
    def request(self) -> object | None:
        """What waits for an acknowledgement: the same object for all tries of one step."""
        return self.steps.request if self._accepted_ms is None else None

    # What happens.

    def on_ack(self, command: int, result: int, progress: int = 0xFF) -> None:
        """COMMAND_ACK addressed to us."""
        if self._waits():
            self.steps.on_ack(command, result, progress)

    def on_text(self, text: StatusText) -> None:
        """STATUSTEXT of the autopilot: a refusal's reason, or an interruption's."""
        self.steps.on_text(text)
        if text.text.startswith(self.plan.rejection_texts):
            self._rejection = text.text
        if self._accepted_ms is not None and text.text.startswith(self.plan.interruption_texts):
            self._interruption = text.text
        self._goes_on |= self._accepted_ms is not None and text.text.startswith(self.plan.onward_texts)

    def on_message(self, name: str, fields: Mapping[str, Any], now_ns: int) -> None:  # noqa: ARG002
        """PARAM_VALUE of the autopilot, or what it says that it flies to."""
        if name == "PARAM_VALUE" and self._waits():
            self.steps.on_parameter(fields["param_id"], fields["param_value"])
        self.setpoints.on_message(name, fields)

    def _waits(self) -> bool:
        """Whether its steps are under way."""
        return self.result is None and self._accepted_ms is None

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

    def _poll(self, state: VehicleState, now_ns: int) -> list[Any]:
        if self._mode_before is None:
            self._mode_before = state.mode
        if self._accepted_ms is not None:
            return [*self._poll_goal(state, now_ns), *self._poll_setpoints(state, now_ns)]
        if self.plan.lead_s is not None:
            leads = self.setpoints.leads(state, now_ns, self.plan.lead_s)
            setpoints = self._poll_setpoints(state, now_ns)
            return setpoints if leads else [*setpoints, *self._poll_steps(state, now_ns)]
        messages = self._poll_steps(state, now_ns)
        return messages if self._accepted_ms is None else [*messages, *self._poll_setpoints(state, now_ns)]

    def _poll_steps(self, state: VehicleState, now_ns: int) -> list[Any]:
        messages = self.steps.poll(state, now_ns)
        if not self.steps.is_over:
            return messages
        self._accepted_ms = self._feedback_ms = state.time_boot_ms
        self._accepted_ns = self._clock_ns = self.setpoints.due_ns = now_ns
        self.tell("accepted", ": ".join(filter(None, ("accepted by the autopilot", self.plan.remark))))
        return self._poll_goal(state, now_ns)

    def _poll_setpoints(self, state: VehicleState, now_ns: int) -> list[Any]:
        return [] if self.result is not None else self.setpoints.poll(state, now_ns, self._accepted_ms)

    def _due_ns(self) -> int | None:
        setpoint_ns = self.setpoints.due_ns
        if self._accepted_ms is not None:
            due_ns = self._clock_ns + self._silence_ns
            return due_ns if self.plan.setpoint is None else min(due_ns, setpoint_ns)
        due_ns = self.steps.due_ns()
        if self.plan.lead_s is None:
            return due_ns
        return min(due_ns, setpoint_ns) if self.steps.was_sent else setpoint_ns

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
        self._rejection = self.setpoints.refusal(state) or self._rejection
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
            self.end(Outcome.INTERRUPTED, NOT_ARMED + self.steps.latest_words)
        elif self._was_not_entered(state, flown_ms):
            self.end(
                Outcome.TIMED_OUT,
                f"accepted, but not begun within {MODE_TIMEOUT_S:g} s of autopilot time: {state.mode}"
                + self.steps.latest_words,
            )
        elif self._interruption:
            self.end(Outcome.INTERRUPTED, self._interruption)
        elif self._has_left(state):
            self.end(Outcome.INTERRUPTED, f"mode changed to {state.mode}" + self.steps.latest_words)
        elif flown_ms > plan.timeout_s * 1000.0:
            self.end(
                Outcome.TIMED_OUT,
                f"not there after {plan.timeout_s:g} s of autopilot time" + self.steps.latest_words,
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
        return state.heard_ns.get(HEARTBEAT, 0) >= self._accepted_ns + round(SHOWN_LAG_S * NS_PER_S)

    def _has_left(self, state: VehicleState) -> bool:
        """Whether it flies in another mode: in one that may be a part of the plan, after some time of it."""
        plan = self.plan
        outside = self._mode_seen and plan.modes and state.mode not in plan.modes
        onward = state.mode in plan.onward_modes
        if not outside or plan.may_leave(state) or (onward and self._goes_on):
            self._left_ms = None
            return False
        if self._left_ms is None:
            self._left_ms = state.time_boot_ms
        grace_ms = ONWARD_GRACE_MS if onward else plan.leave_grace_ms
        return state.time_boot_ms - self._left_ms >= grace_ms

    def _feedback(self, state: VehicleState) -> None:
        self._feedback_ms = state.time_boot_ms
        text, done, total = f"{state.mode}, {state.alt_rel_m:.1f} m above home", None, None
        if self.plan.position is not None:
            done, total = self.plan.position(state)
            text += f", item {done}" + ("" if total is None else f" of {total}")
        remaining_m = self.plan.remaining_m(state)
        text += "" if remaining_m is None else f", {remaining_m:.1f} m to go"
        self.tell("feedback", text, remaining_m=remaining_m, done=done, total=total)
