"""Something asked of the autopilot, from request to result: what all kinds of it have in common. No I/O, no clock.

The owner of an ``Execution`` calls ``poll`` whenever something has happened or its deadline has passed, sends the
messages that come back, and looks at ``events`` and ``result``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final

from aps.timeouts import LINK_LOSS_TIMEOUT_S
from aps.vehicle.state import VehicleState
from aps.vehicle.status_text import StatusText

NS_PER_S: Final = 1_000_000_000


class Outcome(Enum):
    """How a command ended."""

    REACHED = "reached"
    REFUSED = "refused"
    TIMED_OUT = "timed_out"
    INTERRUPTED = "interrupted"
    SUPERSEDED = "superseded"
    """A newer target took the place of this one: nothing has failed."""


@dataclass(frozen=True, slots=True)
class CommandResult:
    """How a command ended, and why."""

    verb: str
    outcome: Outcome
    reason: str = ""
    value: Any = None
    """What was asked for, where something was: a mission, a parameter, the fields of a message."""

    @property
    def reached(self) -> bool:
        """Whether the goal was reached."""
        return self.outcome is Outcome.REACHED

    def __str__(self) -> str:
        reason = f": {self.reason}" if self.reason else ""
        return f"{self.verb} {self.outcome.value.replace('_', ' ')}{reason}"


@dataclass(frozen=True, slots=True)
class CommandProgress:
    """What happens before the result: ``accepted`` once, ``feedback`` every half second of flight."""

    verb: str
    phase: str
    text: str
    remaining_m: float | None = None
    """Distance or height still to go, where there is one."""
    done: int | None = None
    """Items, parameters or bytes so far ..."""
    total: int | None = None
    """... of how many, where that is known."""
    refused: bool = False
    """Whether the autopilot refuses a part of what was asked for, a speed or a heading, and goes on without it."""


class Refusal(RuntimeError):
    """The UA is in no state for what is asked of it; the text says why."""


class Execution(ABC):
    """One request.

    Args:
        verb: what was asked for.
        occupies: what of the UA it takes for itself, e.g. ``flight``; empty for nothing.
    """

    def __init__(self, verb: str, occupies: str = "") -> None:
        self.verb = verb
        self.occupies = occupies
        self.events: list[CommandProgress] = []
        """Progress not yet taken by the owner."""
        self.result: CommandResult | None = None
        self._link_lost_ns: int | None = None

    wanted: frozenset[int] = frozenset()
    """Ids of the messages that it wants, beside acknowledgements, texts and the state."""

    @property
    def request(self) -> object | None:
        """What waits for a COMMAND_ACK: the same object for all tries of one request."""
        return None

    # What happens.

    def poll(self, state: VehicleState, now_ns: int) -> list[Any]:
        """Go as far as possible; returns the pymavlink messages to send now."""
        if self.result is not None:
            return []
        if self._link_lost_ns is not None and now_ns - self._link_lost_ns >= LINK_LOSS_TIMEOUT_S * NS_PER_S:
            self.end(Outcome.TIMED_OUT, f"no link to the autopilot for {LINK_LOSS_TIMEOUT_S:g} s")
            return []
        return self._poll(state, now_ns)

    def deadline_ns(self) -> int | None:
        """Instant of the daemon's clock at which to poll even if nothing happens; ``None`` when there is none."""
        if self.result is not None:
            return None
        candidates = [self._due_ns()]
        if self._link_lost_ns is not None:
            candidates.append(self._link_lost_ns + round(LINK_LOSS_TIMEOUT_S * NS_PER_S))
        return min((due_ns for due_ns in candidates if due_ns is not None), default=None)

    def on_message(self, name: str, fields: Mapping[str, Any], now_ns: int) -> None:  # noqa: B027
        """A message of one of ``wanted``, from the autopilot and for us or for all."""

    def on_other_system(self, sysid: int, fields: Mapping[str, Any]) -> None:  # noqa: B027
        """PARAM_VALUE of another system's autopilot on our autopilot's link: which ours may have become."""

    def on_ack(self, command: int, result: int, progress: int = 0xFF) -> None:  # noqa: B027
        """COMMAND_ACK for a request of this one."""

    def on_text(self, text: StatusText) -> None:  # noqa: B027
        """STATUSTEXT of the autopilot."""

    def on_link(self, connected: bool, now_ns: int) -> None:
        """The link to the autopilot went down or came back."""
        self._link_lost_ns = None if connected else now_ns

    def on_reboot(self) -> None:
        """The autopilot has rebooted."""
        self.interrupt("the autopilot rebooted")

    # How it ends.

    def refuse(self, reason: str) -> None:
        """It cannot even be sent."""
        self.end(Outcome.REFUSED, reason)

    def interrupt(self, reason: str) -> None:
        """Another command takes over, the autopilot rebooted, the daemon stops."""
        self.end(Outcome.INTERRUPTED, reason)

    def supersede(self, reason: str) -> None:
        """A newer target takes the place of this one."""
        self.end(Outcome.SUPERSEDED, reason)

    def end(self, outcome: Outcome, reason: str = "", value: Any = None) -> None:
        """Set the result, unless there is one."""
        if self.result is None:
            self.result = CommandResult(self.verb, outcome, reason, value)

    def tell(
        self,
        phase: str,
        text: str,
        *,
        remaining_m: float | None = None,
        done: int | None = None,
        total: int | None = None,
        refused: bool = False,
    ) -> None:
        """Add a piece of progress."""
        self.events.append(CommandProgress(self.verb, phase, text, remaining_m, done, total, refused))

    # What each kind does.

    @abstractmethod
    def _poll(self, state: VehicleState, now_ns: int) -> list[Any]:
        """As ``poll``, while there is no result."""

    @abstractmethod
    def _due_ns(self) -> int | None:
        """As ``deadline_ns``, while there is no result."""
