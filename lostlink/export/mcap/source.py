"""What the messages of a file come from: each source gives them window by window of sim time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.reader import Names, joined, read_batches
from bridge.record.tables.schema import Columns, Table
from lostlink.export.mcap.file import Channel

FOREVER_NS: Final = 1 << 62
"""Until then a source gives all that is left."""
Item = tuple[int, Channel, bytes]
"""Sim time in ns, where to, and the message."""


class Source(Protocol):
    """One part of a record."""

    def until(self, time_ns: int) -> Iterable[Item]:
        """Its messages up to ``time_ns`` that it has not given yet, each topic's in order."""


class Feed:
    """A source that has one message after the other; those that come too soon after the last are left out."""

    def __init__(self, items: Iterator[Item]) -> None:
        self._items = items
        self._next = next(items, None)

    def until(self, time_ns: int) -> Iterator[Item]:
        """The messages up to ``time_ns``."""
        while self._next is not None and self._next[0] <= time_ns:
            if self._next[1].is_due(self._next[0]):
                yield self._next
            self._next = next(self._items, None)


class Slices:
    """A table, in slices of time.

    Args:
        run: the run directory.
        table: which table; none if the run does not have it.
        names: of what columns are read as places.
        by: the column of instants by which rows rise; the table's tick unless given.
    """

    def __init__(self, run: Path, table: Table, names: Names, by: str = "") -> None:
        self._batches = read_batches(run, table, None, names) if table.is_in(run) else iter(())
        self._tick = by or table.tick
        self._kept: list[Columns] = []

    def until(self, time_ns: int) -> Columns | None:
        """The rows up to the first that is later than ``time_ns``; None if there are none."""
        while not self._kept or self._kept[-1][self._tick][-1] <= time_ns:
            batch = next(self._batches, None)
            if batch is None:
                break
            if len(batch[self._tick]):
                self._kept.append(batch)
        if not self._kept:
            return None
        whole = joined(self._kept) if len(self._kept) > 1 else self._kept[0]
        later = np.flatnonzero(whole[self._tick] > time_ns)
        count = int(later[0]) if later.size else len(whole[self._tick])
        self._kept = [{n: v[count:] for n, v in whole.items()}] if count < len(whole[self._tick]) else []
        return {name: values[:count] for name, values in whole.items()} if count else None


class Thinning:
    """Which of a topic's messages are written: the first of each period."""

    def __init__(self, rate_hz: float | None) -> None:
        self._period_ns = min(round(1e9 / rate_hz), FOREVER_NS) if rate_hz else 0
        self._last = -1

    def chosen(self, times_ns: NDArray[np.int64]) -> NDArray[np.intp]:
        """Places of those that are written, of times in order."""
        if not self._period_ns or not times_ns.size:
            return np.arange(times_ns.size)
        periods = times_ns // self._period_ns
        first = np.flatnonzero(np.diff(periods, prepend=self._last))
        self._last = int(periods[-1])
        return first


def rows_of_nodes(columns: Columns, nodes: Sequence[str]) -> Iterator[tuple[str, Columns]]:
    """A table's rows of each node; ``node`` is a place in ``nodes``."""
    for place in np.unique(columns["node"]).tolist():
        yield nodes[place], picked(columns, np.flatnonzero(columns["node"] == place))


def picked(columns: Columns, places: NDArray[np.intp]) -> Columns:
    """Some rows."""
    return {name: values[places] for name, values in columns.items()}
