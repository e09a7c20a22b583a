"""All journals of a table as one: rows in the order of ticks, and of nodes within a tick."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.journal import Labels, checked_places, read_rows
from bridge.record.tables.schema import Table

Rows = NDArray[np.void]


def rows_of(run: Path, table: Table, rows: int) -> tuple[Labels, Iterator[Rows]]:
    """The names of a table's journals, and their rows in arrays of ``rows``, the last one shorter.

    Raises:
        TableError: a file is not the journal of such a table, or a row has no name.
        OSError: one cannot be read.
    """
    paths = table.journals(run)
    share = max(1, rows // max(1, len(paths)))
    found = [read_rows(path, table, share) for path in paths]
    labels: Labels = dict.fromkeys(table.labels, ())
    parts = []
    for path, (names, arrays) in zip(paths, found, strict=True):
        begin = {name: len(labels[name]) for name in labels}
        labels = {name: labels[name] + names[name] for name in labels}
        parts.append(_shifted(path, arrays, names, begin))
    return labels, _in_arrays(parts[0] if len(parts) == 1 else _merged(parts, table.tick), rows)


def _shifted(path: Path, arrays: Iterator[Rows], names: Labels, begin: dict[str, int]) -> Iterator[Rows]:
    """Rows whose names have their places among those of all journals."""
    for rows in arrays:
        for column, first in begin.items():
            checked_places(path, names[column], rows[column])
            if first:
                rows[column] += first
        yield rows


def _merged(parts: Sequence[Iterator[Rows]], tick: str) -> Iterator[Rows]:
    """Rows of all parts by tick; within a tick, by part."""
    waiting = {place: rows for place, part in enumerate(parts) if (rows := next(part, None)) is not None}
    while waiting:
        until_ns = min(rows[tick][-1] for rows in waiting.values())
        counts = {
            place: int(np.searchsorted(rows[tick], until_ns, "right")) for place, rows in waiting.items()
        }
        together = np.concatenate([waiting[place][:count] for place, count in counts.items()])
        yield together[np.argsort(together[tick], kind="stable")]
        for place, count in counts.items():
            rest: Rows | None = waiting[place][count:]
            if rest is not None and not len(rest):
                rest = next(parts[place], None)
            if rest is None:
                del waiting[place]
            else:
                waiting[place] = rest


def _in_arrays(arrays: Iterator[Rows], rows: int) -> Iterator[Rows]:
    """The same rows, so many at a time."""
    kept: list[Rows] = []
    for each in arrays:
        rest = each
        while sum(map(len, kept)) + len(rest) >= rows:
            count = rows - sum(map(len, kept))
            yield np.concatenate([*kept, rest[:count]]) if kept else rest[:count]
            kept, rest = [], rest[count:]
        if len(rest):
            kept.append(rest)
    if kept:
        yield np.concatenate(kept) if len(kept) > 1 else kept[0]
