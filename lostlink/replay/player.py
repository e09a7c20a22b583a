"""A record tick by tick, as the run went: no I/O but the record's files, no clock, no Zenoh.

player = Player.open(run)
player.seek(30_000_000_000)
while (moment := player.step()) is not None:
    show(moment.truths(), moment.fates())
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from lostlink.reading.links.known import KnownLinks
from lostlink.replay.moment import Moment
from lostlink.replay.record import TickedRecord

ROWS_AT_ONCE = 1 << 16
"""That are taken on the way to an instant."""


class Player:
    """Plays one record. For one thread at a time.

    Args:
        record: of a run.

    Attributes:
        now: the moment that was played last; None before the first.
    """

    def __init__(self, record: TickedRecord) -> None:
        self.record = record
        self.now: Moment | None = None
        self._next = 0
        self._begin()

    @classmethod
    def open(cls, run: Path) -> Player:
        """Of the record in a directory; raises what `TickedRecord` does."""
        return cls(TickedRecord(run))

    def _begin(self) -> None:
        self._links = KnownLinks(self.record.nodes, self.record.networks, self.record.radios)

    # Which ticks there are.

    @property
    def begin_ns(self) -> int:
        """The first tick."""
        return int(self.record.ticks_ns[0])

    @property
    def end_ns(self) -> int:
        """The last tick."""
        return int(self.record.ticks_ns[-1])

    @property
    def following_ns(self) -> int | None:
        """The tick that `step` plays; None at the end."""
        return int(self.record.ticks_ns[self._next]) if self._next < self.record.ticks_ns.size else None

    # Playing.

    def step(self) -> Moment | None:
        """Play the next tick; None when there is none."""
        if self._next >= self.record.ticks_ns.size:
            return None
        return self._play(self._rows_before(self._next))

    def moments(self) -> Iterator[Moment]:
        """Play from the next tick to the end."""
        while (moment := self.step()) is not None:
            yield moment

    def seek(self, sim_time_ns: int) -> Moment:
        """Play the last tick at or before an instant, or the first: as if all ticks before it had been played."""
        tick = max(0, int(np.searchsorted(self.record.ticks_ns, sim_time_ns, side="right")) - 1)
        begin = self._rows_before(self._next)
        if tick < self._next:
            begin = 0
            self._begin()
        before = self._rows_before(tick)
        for part in range(begin, before, ROWS_AT_ONCE):
            self._links.take(self.record.decisions.at(part, min(part + ROWS_AT_ONCE, before)).each().columns)
        self._links.picture.changed()  # those of ticks that are passed over
        self._next = tick
        return self._play(before)

    def _play(self, begin: int) -> Moment:
        tick, self._next = self._next, self._next + 1
        decided = self.record.decisions.at(begin, self._rows_before(self._next))
        self._links.take(decided.each().columns)
        if self.now is not None:
            self.now.is_over = True
        self.now = Moment(self.record, self._links, tick, decided, self._links.picture.changed())
        return self.now

    def _rows_before(self, tick: int) -> int:
        """How many rows of the decisions were settled before a tick."""
        return int(self.record.rows_until[tick - 1]) if tick else 0
