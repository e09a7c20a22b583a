"""The steps of a plan, sent one after the other: each until it is acknowledged, refused or tried often enough."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Final

from aps.timeouts import (
    ACK_TIMEOUTS_S,
    IN_PROGRESS_TIMEOUT_S,
    REASON_GRACE_S,
    SHOWN_LAG_S,
    SHOWN_TIMEOUT_S,
)
from aps.vehicle.commands.plan import CommandPlan, Step
from aps.vehicle.execution import NS_PER_S, Execution, Outcome
from aps.vehicle.state import VehicleState
from aps.vehicle.status_text import StatusText, reasons
from aps.wire.dialect import enum_label, mavlink

PARAMETER_TOLERANCE: Final = 1.0
AGAIN_S: Final = 0.25
"""After so long a step that was rejected for now is sent again."""
HEARTBEAT: Final = 0

_ACCEPTED: Final = int(mavlink.MAV_RESULT_ACCEPTED)
_IN_PROGRESS: Final = int(mavlink.MAV_RESULT_IN_PROGRESS)
_NOT_NOW: Final = int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED)


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


class StepSequence:
    """Gets the steps of one plan acknowledged.

    Args:
        plan: whose steps.
        command: told of progress, and ended where a step is refused or not acknowledged.
    """

    def __init__(self, plan: CommandPlan, command: Execution) -> None:
        self._plan, self._command = plan, command
        self._step = 0
        self._waiting = _Waiting()
        self._said_before: list[str] = []
        """What may be the reason of a refusal to which nothing is said: of tries before, or of what led up to it."""

    @property
    def request(self) -> object:
        """What waits for an acknowledgement: the same object for all tries of one step."""
        return self._waiting

    @property
    def is_over(self) -> bool:
        """Whether all steps were accepted."""
        return self._step >= len(self._plan.steps)

    @property
    def was_sent(self) -> bool:
        """Whether the present step was."""
        return self._waiting.tries > 0

    @property
    def latest_words(self) -> str:
        """What the autopilot said last, in brackets; empty for nothing."""
        return f" ({self._waiting.texts[-1]})" if self._waiting.texts else ""

    def due_ns(self) -> int:
        """When to poll though nothing happens."""
        waiting = self._waiting
        return waiting.deadline_ns if waiting.refused_ns is None else self._reason_due_ns()

    @property
    def _present(self) -> Step:
        return self._plan.steps[self._step]

    # What happens.

    def on_ack(self, command: int, result: int, progress: int) -> None:
        """COMMAND_ACK addressed to us. One that answers nothing we wait for is ignored."""
        if self._waiting.answer is None and self._present.command == command:
            if result == _IN_PROGRESS:
                self._waiting.in_progress = True
                share = "" if progress == 0xFF else f", {progress} %"
                self._command.tell("feedback", f"in progress{share}")
            else:
                self._waiting.answer = result

    def on_parameter(self, name: str, value: float) -> None:
        """PARAM_VALUE of the autopilot; also one that somebody else has asked for."""
        step = self._present
        is_value = step.parameter == name and abs(value - step.value) <= PARAMETER_TOLERANCE
        if is_value and self._waiting.answer is None:
            self._waiting.answer = _ACCEPTED

    def on_text(self, text: StatusText) -> None:
        """STATUSTEXT of the autopilot: a refusal's reason, or an interruption's."""
        if text.may_be_a_reason and text.text not in self._waiting.texts:
            self._waiting.texts.append(text.text)

    def follows(self, texts: Iterable[StatusText]) -> None:
        """What the autopilot has said to that which led up to these steps, e.g. to the upload of a mission."""
        self._said_before = reasons(texts)

    # Sending.

    def poll(self, state: VehicleState, now_ns: int) -> list[Any]:
        """Go as far as possible; returns the messages to send now."""
        if self.is_over:
            return []
        done = self._present.done
        if done is not None and self._waiting.tries and done(state):
            self._waiting.answer = _ACCEPTED
        if self._is_yet_to_be_shown(state, now_ns):
            return []
        if self._waiting.answer == _ACCEPTED:
            self._waiting = _Waiting(texts=self._waiting.texts if self._present.explains else [])
            self._step += 1
            if self.is_over:
                return []
        if self._tries_again(now_ns):
            return []
        if self._waiting.answer is not None:
            self._refused(self._waiting.answer, now_ns)
            return self.poll(state, now_ns) if self._waiting.answer == _ACCEPTED else []
        if now_ns < self._waiting.deadline_ns:
            if self._waiting.in_progress:
                self._waiting.deadline_ns = now_ns + round(IN_PROGRESS_TIMEOUT_S * NS_PER_S)
                self._waiting.tries = len(ACK_TIMEOUTS_S)
                self._waiting.in_progress = False
            return []
        return self._send(now_ns)

    def _send(self, now_ns: int) -> list[Any]:
        waiting = self._waiting
        if waiting.tries >= len(ACK_TIMEOUTS_S):
            self._command.end(Outcome.TIMED_OUT, f"no acknowledgement after {waiting.tries} tries")
            return []
        message = self._present.message(waiting.tries)
        waiting.deadline_ns = now_ns + round(ACK_TIMEOUTS_S[waiting.tries] * NS_PER_S)
        waiting.tries += 1
        return [message]

    def _is_yet_to_be_shown(self, state: VehicleState, now_ns: int) -> bool:
        """Whether what was acknowledged may still be seen to be done; where it is not, the answer becomes a rejection.

        Where no heartbeat comes, the acknowledgement counts.
        """
        waiting = self._waiting
        if waiting.answer != _ACCEPTED:
            return False
        shown = self._present.shown
        if shown is None or shown(state) or waiting.refused_ns is not None:
            return False
        if waiting.acknowledged_ns is None:
            waiting.acknowledged_ns = now_ns
            waiting.deadline_ns = now_ns + round(SHOWN_TIMEOUT_S * NS_PER_S)
        if state.heard_ns.get(HEARTBEAT, 0) >= waiting.acknowledged_ns + round(SHOWN_LAG_S * NS_PER_S):
            waiting.answer, waiting.acknowledged_ns = _NOT_NOW, None
            return False
        return now_ns < waiting.deadline_ns

    def _tries_again(self, now_ns: int) -> bool:
        """Whether the step was rejected for now, and is to be sent again a little later."""
        waiting, patience_ns = self._waiting, round(self._present.patience_s * NS_PER_S)
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
        waiting, step = self._waiting, self._present
        if waiting.refused_ns is None:
            waiting.refused_ns = now_ns
        if not waiting.texts and now_ns < self._reason_due_ns():
            return
        words = "; ".join(waiting.texts or self._said_before)
        label = enum_label("MAV_RESULT", result)
        reason = f"{label}: {words}" if words else label
        name = enum_label("MAV_CMD", step.command or 0)
        if step.optional:
            why = f" ({step.hint})" if step.hint and not words else ""
            self._command.tell("feedback", f"{name} refused: {reason}{why}", refused=True)
            waiting.answer = _ACCEPTED
            return
        hint = self._plan.refusal_hint or f"{name}; the autopilot does not say why"
        self._command.end(Outcome.REFUSED, reason if words else f"{reason} ({hint})")

    def _reason_due_ns(self) -> int:
        return (self._waiting.refused_ns or 0) + round(REASON_GRACE_S * NS_PER_S)
