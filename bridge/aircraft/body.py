"""What a node is beside its agent: what is heard, said and commanded at a tick, whether it flies or not."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from aps.inputs import Input
from bridge.bus.messages import AircraftState, CommandEvent, CommandGoal

OnEvent = Callable[[CommandEvent], object]
STATE_RATE_HZ = 10
"""How often the state is published, sim time; the node's agent sees it at every tick."""


class Body(Protocol):
    """A node's aircraft, or the lack of one."""

    takes_input: bool
    """Whether clients and operators are listened to; not when a record is flown again."""

    def inject(self, inputs: Sequence[Input]) -> None:
        """Take what clients said, from a record."""

    def swap(self) -> None:
        """With lookahead, ahead of `begin`: say what was decided the instant before, and hear; then it may fly on."""

    def begin(self, now_ns: int) -> None:
        """Hear what there is to hear at this instant."""

    def end(self) -> None:
        """Say what is to be said at this instant."""

    def state(self) -> AircraftState:
        """Table I of the paper."""

    def start(self, verb: str, goal: CommandGoal, on_event: OnEvent) -> None:
        """Begin to carry out ``verb``; ``on_event`` is called with progress and, once, with the result."""


class StatePace:
    """Decides when a node's state is published: STATE_RATE_HZ on the mean, at any tick rate from that up."""

    def __init__(self) -> None:
        self._next_ns = 0

    def is_due(self, now_ns: int) -> bool:
        """Whether it is at this tick."""
        if now_ns < self._next_ns:
            return False
        period_ns = 1_000_000_000 // STATE_RATE_HZ
        self._next_ns = (now_ns // period_ns + 1) * period_ns
        return True
