"""What happens next: events in the order of time, then rank, then node, then number.

Nodes are in the order of their ids where they have some, however they are listed.

Networks that hear each other have an agenda each on one clock: of events of one instant and rank, those of the network
that comes first happen first.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

import numpy as np

SIGNAL_ENDS, ACTS, SIGNAL_STARTS = 0, 1, 2
"""Ranks. Who acts at an instant does not hear yet what starts at it: two that act at one instant collide."""

ALONE_NEVER_NS = -1
"""Until when an agenda on a shared clock may go on by itself."""

Entry = list[Any]
"""[instant ns, rank, place of the node, number, callback, arguments]; of one that was called off no callback."""
NO_ORDER: Final[Mapping[int, int]] = MappingProxyType({})


class Agenda:
    """Events to come. Two agendas that were given the same do the same.

    Args:
        order: the place of each node among those that do something at one instant; its number unless given.
    """

    def __init__(self, order: Mapping[int, int] = NO_ORDER) -> None:
        self._order = order
        self.now_ns = self._until_ns = 0
        self.handled = 0
        self._entries: list[Entry] = []
        self._number = 0
        self._clock: SharedClock | None = None

    def at(
        self, at_ns: int, rank: int, node: int, callback: Callable[..., object], *arguments: object
    ) -> Entry:
        """Have ``callback`` called at an instant; the entry can be called off.

        Raises:
            ValueError: the instant has passed.
        """
        if at_ns < self.now_ns:
            raise ValueError(f"an event at {at_ns} ns: it is {self.now_ns} ns already")
        self._number += 1
        entry: Entry = [at_ns, rank, self._order.get(node, node), self._number, callback, arguments]
        heapq.heappush(self._entries, entry)
        return entry

    @staticmethod
    def call_off(entry: Entry | None) -> None:
        """Nothing happens at an entry; None is no entry."""
        if entry is not None:
            entry[4] = None

    @property
    def next_ns(self) -> int | None:
        """When the next event is due; None: nothing is to come."""
        entries = self._entries
        while entries and entries[0][4] is None:
            heapq.heappop(entries)
        return entries[0][0] if entries else None

    @property
    def until_ns(self) -> int:
        """Up to which instant events happen in this run."""
        return self._until_ns

    def goes_on_to(self, at_ns: int) -> bool:
        """Come to a later instant, if nothing else is due by then: an event may go on without an entry of its own."""
        if at_ns > self._until_ns or (self._entries and self._entries[0][0] <= at_ns):
            return False
        self.now_ns = at_ns
        return True

    def join(self, clock: SharedClock) -> None:
        """Run with others from now on; nothing was run yet."""
        self._clock, self._until_ns = clock, ALONE_NEVER_NS

    @property
    def head(self) -> tuple[int, int] | None:
        """Instant and rank of the next event; None: nothing is to come."""
        return None if self.next_ns is None else (self._entries[0][0], self._entries[0][1])

    def step(self) -> None:
        """Let the next event happen."""
        self.now_ns, _, _, _, callback, arguments = heapq.heappop(self._entries)
        self.handled += 1
        callback(*arguments)

    def run(self, until_ns: int) -> None:
        """Let everything happen that is due by ``until_ns``, and come to it; so do those on the same clock."""
        if self._clock is not None:
            self._clock.run(until_ns)
            return
        entries, pop, self._until_ns = self._entries, heapq.heappop, until_ns
        while entries and entries[0][0] <= until_ns:
            at_ns, _, _, _, callback, arguments = pop(entries)
            if callback is not None:
                self.now_ns = at_ns
                self.handled += 1
                callback(*arguments)
        self.now_ns = max(self.now_ns, until_ns)


class WholeAgenda(Agenda):
    """An agenda whose instants are looked at: of a medium of a user's own."""

    def at(
        self, at_ns: int, rank: int, node: int, callback: Callable[..., object], *arguments: object
    ) -> Entry:
        """Have ``callback`` called at an instant; the entry can be called off.

        Raises:
            ValueError: the instant has passed, or is no integer.
        """
        if not isinstance(at_ns, int | np.integer):
            raise ValueError(f"an event at {at_ns!r} ns: instants are whole")
        return super().at(int(at_ns), rank, node, callback, *arguments)


class SharedClock:
    """One time for several agendas: the running of one is that of all.

    Args:
        agendas: of networks, in their order; nothing was run of them yet.
    """

    def __init__(self, agendas: Sequence[Agenda]) -> None:
        self._agendas = tuple(agendas)
        for agenda in self._agendas:
            agenda.join(self)

    def run(self, until_ns: int) -> None:
        """Let everything happen on all agendas that is due by ``until_ns``, and come to it."""
        while (agenda := self._next(until_ns)) is not None:
            agenda.step()
        for agenda in self._agendas:
            agenda.now_ns = max(agenda.now_ns, until_ns)

    def _next(self, until_ns: int) -> Agenda | None:
        """Whose event is next; None: nothing is due."""
        heads = [(head, place) for place, each in enumerate(self._agendas) if (head := each.head) is not None]
        (at_ns, _), place = min(heads, default=((until_ns + 1, 0), 0))
        return self._agendas[place] if at_ns <= until_ns else None
