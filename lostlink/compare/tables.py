"""The first row in which two tables differ."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.reader import no_rows, read_batches
from bridge.record.tables.schema import Columns, Table
from channel.medium.reception import Fate
from lostlink.compare.difference import Difference
from lostlink.compare.explain import NOTHING

NEVER_NS: Final = (1 << 63) - 1
RECEIVED: Final = "received_ns"
OnEqual = Callable[[NDArray[np.int64]], object]


def compare_table(
    run_a: Path, run_b: Path, table: Table, until_ns: int | None, *, a_was_cut: bool, on_equal: OnEqual
) -> Difference | None:
    """The first row that differs; None if there is none.

    Args:
        run_a: the first run's directory.
        run_b: the second run's.
        table: which table.
        until_ns: pass over rows of later sim times.
        a_was_cut: the first run was killed: its table may end early.
        on_equal: called with the sim times of rows that are equal, some at a time.

    Raises:
        TableError, OSError: a file is damaged or cannot be read.
    """
    has = [table.is_in(run) for run in (run_a, run_b)]
    if not all(has):
        if a_was_cut and not has[0]:
            return None
        texts = ("the table" if each else f"no {table.name}" for each in has)
        return Difference(0, "", table.name, "the table", *texts)
    keep = _Kept(run_a, run_b, table, until_ns, _ends(run_a, table) if a_was_cut and table.by_node else None)
    one, other = (_Rows(run, table, keep) for run in (run_a, run_b))
    while True:
        count = min(one.available(), other.available())
        if count == 0:
            break
        index, column = _first_difference(one.take(count), other.take(count), table)
        if index < count:
            one.back(count - index)
            other.back(count - index)
        if index:
            on_equal(one.before(index, table.tick))
        if column:
            return _difference(one.row(), other.row(), table, one.done, column)
    if one.available() == other.available() or (a_was_cut and not one.available()):
        return None
    return _difference(one.row(), other.row(), table, one.done, "")


class _Rows:
    """One run's table: the rows that are next."""

    def __init__(self, run: Path, table: Table, keep: _Kept) -> None:
        self._names = [column.name for column in table.columns]
        self._batches = keep.rows(read_batches(run, table))
        self._batch = no_rows(table)
        self._next = 0
        self.done = 0

    def available(self) -> int:
        """How many rows there are before the file is to be read on; 0: the table ends."""
        while self._next == len(self._batch[self._names[0]]):
            batch = next(self._batches, None)
            if batch is None:
                return 0
            self._batch, self._next = batch, 0
        return len(self._batch[self._names[0]]) - self._next

    def take(self, count: int) -> Columns:
        """The next rows."""
        found = {name: values[self._next : self._next + count] for name, values in self._batch.items()}
        self._next += count
        self.done += count
        return found

    def back(self, count: int) -> None:
        """Give the last rows back."""
        self._next -= count
        self.done -= count

    def before(self, count: int, column: str) -> NDArray[Any]:
        """A column of the rows taken last."""
        return self._batch[column][self._next - count : self._next]

    def row(self) -> dict[str, Any] | None:
        """The next row; None if the table ends."""
        if not self.available():
            return None
        return {name: self._batch[name][self._next] for name in self._names}


class _Kept:
    """Which rows of two tables are compared.

    Packets that were still on their way when one of the runs ended have no fate there, or another: up to a sim time the
    rows of both are passed over.

    Args:
        run_a, run_b: the runs.
        table: which table.
        until_ns: pass over rows of later sim times; None: compare all.
        ends: for each node the sim time at which its part of the table ends; None: that of all is one.
    """

    def __init__(
        self, run_a: Path, run_b: Path, table: Table, until_ns: int | None, ends: dict[str, int] | None
    ) -> None:
        self._node, self._ends = table.node, ends
        self._tick, self._until_ns = table.tick, NEVER_NS if until_ns is None else until_ns
        self._received_ns: int | None = None
        if self._until_ns < NEVER_NS and RECEIVED in [column.name for column in table.columns]:
            self._received_ns = min(_latest(run, table, self._until_ns) for run in (run_a, run_b))

    def rows(self, batches: Iterator[Columns]) -> Iterator[Columns]:
        """Those of the batches that are."""
        for batch in batches:
            kept = batch[self._tick] <= self._until_ns
            if self._received_ns is not None:
                kept &= (batch[RECEIVED] <= self._received_ns) & (batch["fate"] != Fate.RUN_ENDED.value)
            if self._ends is not None:
                kept &= batch[self._tick] <= [self._ends.get(node, -1) for node in batch[self._node]]
            yield batch if kept.all() else {name: values[kept] for name, values in batch.items()}


def _ends(run: Path, table: Table) -> dict[str, int]:
    """The last tick of each node in a table: each has a journal of its own, and of a killed run each has an end."""
    found: dict[str, int] = {}
    for batch in read_batches(run, table, (table.tick, table.node)):
        found |= dict(zip(batch[table.node].tolist(), batch[table.tick].tolist(), strict=True))
    return found


def _latest(run: Path, table: Table, until_ns: int) -> int:
    """When the last packet of those up to a sim time was received: what is settled at the end may come later."""
    batches = read_batches(run, table, (table.tick, RECEIVED))
    return max(
        (int(batch[RECEIVED].max(where=batch[table.tick] <= until_ns, initial=-1)) for batch in batches),
        default=-1,
    )


def _first_difference(a: Columns, b: Columns, table: Table) -> tuple[int, str]:
    """The first row that differs and its first such column; the number of rows and "" if none does."""
    count = len(a[table.tick])
    first, found = count, ""
    for column in table.columns:
        differs = np.flatnonzero(_differs(a[column.name][:first], b[column.name][:first]))
        if differs.size:
            first, found = int(differs[0]), column.name
    return first, found


def _differs(a: NDArray[Any], b: NDArray[Any]) -> NDArray[np.bool_]:
    if a.dtype.kind != "f":
        return np.asarray(a != b)
    # By bits, so that -0.0 is not 0.0; but nan is nan.
    as_bits = (np.ascontiguousarray(side).view(np.int64) for side in (a, b))
    different: NDArray[np.bool_] = np.not_equal(*as_bits) & ~(np.isnan(a) & np.isnan(b))
    return different


def _difference(
    a: dict[str, Any] | None, b: dict[str, Any] | None, table: Table, number: int, column: str
) -> Difference:
    rows = [row for row in (a, b) if row is not None]
    row = min(rows, key=lambda each: int(each[table.tick]))
    at = (int(row[table.tick]), str(row[table.node]), table.name)
    if a is None or b is None or any(a[key] != b[key] for key in table.keys):
        texts = (f"{NOTHING}: the table ends" if each is None else _text(each) for each in (a, b))
        return Difference(*at, f"row {number}", *texts)
    return Difference(*at, f"{column} in row {number}", str(a[column]), str(b[column]))


def _text(row: dict[str, Any]) -> str:
    return ", ".join(f"{name} {value}" for name, value in row.items())
