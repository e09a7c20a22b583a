"""The ring at the radio: a tick is closed when every regulated node has answered it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

NEVER_NS = 1 << 62


class Closed(NamedTuple):
    """An instant that everybody has answered.

    Attributes:
        sim_time_ns: the instant.
        is_tick: a tick, or only an exchange of MAVLink between two ticks.
        is_end: the run ends with it.
    """

    sim_time_ns: int
    is_tick: bool
    is_end: bool


class Ring:
    """Who has answered.

    Args:
        regulated: ids of the nodes that are waited for.
        tasks: ids of the nodes whose agents have a task: when all are done, the run ends with that tick.
        end_ns: the tick at which the run ends at the latest.
        tick_period_ns: sim time between ticks.
    """

    def __init__(
        self,
        regulated: Iterable[str],
        *,
        tasks: Iterable[str] = (),
        end_ns: int = NEVER_NS,
        tick_period_ns: int = 1,
    ) -> None:
        self._answered = dict.fromkeys(regulated, -1)
        self._missing = len(self._answered)
        self._closed_ns = -1
        self._tick_ns = 0
        self._tasks = set(tasks)
        self._end_ns = end_ns
        self.tick_period_ns = tick_period_ns

    @property
    def waiting_for(self) -> tuple[str, ...]:
        """Nodes that have not answered the latest tick."""
        return tuple(node for node, at in self._answered.items() if at < self._tick_ns)

    @property
    def received_ns(self) -> int:
        """The tick at which nodes get what is settled now: the one after the latest that all have answered."""
        return (self._closed_ns // self.tick_period_ns + 1) * self.tick_period_ns

    def __contains__(self, node: str) -> bool:
        return node in self._answered

    def tick(self, sim_time_ns: int) -> None:
        """Take a tick of the fleet clock."""
        self._tick_ns = max(self._tick_ns, sim_time_ns)

    def answer(self, node: str, sim_time_ns: int) -> Closed | None:
        """Take a node's word that it has done all it will do at an instant; returns whether that closes it.

        Raises:
            KeyError: nobody waits for this node.
        """
        before = self._answered[node]
        self._answered[node] = max(before, sim_time_ns)
        if before <= self._closed_ns < sim_time_ns:
            self._missing -= 1
        if self._missing:
            return None
        self._closed_ns = min(self._answered.values())
        self._missing = sum(at <= self._closed_ns for at in self._answered.values())
        is_tick = self._closed_ns % self.tick_period_ns == 0
        return Closed(self._closed_ns, is_tick, is_tick and self._closed_ns >= self._end_ns)

    def done(self, node: str) -> None:
        """Take an agent's word that its task is done."""
        if node in self._tasks:
            self._tasks.discard(node)
            if not self._tasks:
                self.end()

    def end(self) -> None:
        """End the run with the tick that is open now."""
        self._end_ns = min(self._end_ns, self._closed_ns + 1)
