"""The first difference between two runs, over all streams and tables in the order of sim time.

Within a tick the order is that of cause: truth, MAVLink from the autopilot, MAVLink to it, what the agent logged,
packets, states, measurements, deliveries. Files are read side by side and only as far as needed; of each, one tick or
some rows are in memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.record.names import Kind, Stream, streams_of
from bridge.record.provenance import version_noted
from bridge.record.streams import Entry, read_stream
from bridge.record.tables.every import TABLES
from bridge.record.tables.schema import Table
from bridge.record.tables.truth import TRUTH
from lostlink.compare.difference import Comparison, Difference, seconds
from lostlink.compare.explain import NOTHING, describe, explain
from lostlink.compare.tables import compare_table

BEFORE_BYTES = 600
"""Of what both streams had, so much is kept: two MAVLink frames of the longest kind."""
TOGETHER_MAX_BYTES = 1 << 20
PROGRESS_ENTRIES = 1000
NEVER_NS = (1 << 63) - 1
OnProgress = Callable[[str, int], object]
_KINDS = list(Kind)
_BYTE_STREAMS = {Kind.FROM_AUTOPILOT, Kind.TO_AUTOPILOT, Kind.TO_MODEM, Kind.FROM_MODEM}


class NotARun(ValueError):
    """A directory has nothing that could be compared."""


def compare(run_a: Path, run_b: Path, until_ns: int | None = None) -> Difference | None:
    """The first difference between two run directories; None if there is none.

    Args:
        run_a: the first run.
        run_b: the second run.
        until_ns: compare no later ticks.

    Raises:
        NotARun: one of them is no run directory, or has no record.
        StreamError, ValueError, OSError: a file is damaged, has a foreign name or cannot be read.
    """
    return examine(run_a, run_b, until_ns).difference


def examine(
    run_a: Path,
    run_b: Path,
    until_ns: int | None = None,
    *,
    a_was_cut: bool = False,
    on_progress: OnProgress | None = None,
) -> Comparison:
    """As `compare`, and return what was compared.

    Args:
        run_a: the first run.
        run_b: the second run.
        until_ns: compare no later ticks.
        a_was_cut: the first run was killed: where a file of it ends is no difference.
        on_progress: called now and then with a stream's name and the entries compared so far.

    Raises:
        NotARun, StreamError, ValueError, OSError: as `compare`.
    """
    work = _Work(run_a, run_b, NEVER_NS if until_ns is None else until_ns, a_was_cut, on_progress)
    for run in (run_a, run_b):
        with version_noted(run):
            _check_run(run)
    with version_noted(run_a, run_b):
        return _examined(work, run_a, run_b)


def _examined(work: _Work, run_a: Path, run_b: Path) -> Comparison:
    in_a, in_b = set(streams_of(run_a)), set(streams_of(run_b))
    parts: list[Stream | Table] = [TRUTH, *sorted(in_a | in_b, key=_order), *TABLES[1:]]
    for each in parts:
        if isinstance(each, Stream):
            work.take(str(each), work.compare_stream(each, in_a, in_b))
        elif each.is_in(run_a) or each.is_in(run_b):
            work.take(each.name, work.compare_table(each))
    return Comparison(work.first, tuple(work.names), work.entries, work.ticks)


def _check_run(run: Path) -> None:
    if not run.is_dir():
        raise NotARun(f"{run}: no such directory")
    if not any(table.is_in(run) for table in TABLES) and not streams_of(run):
        raise NotARun(
            f"{run}: not the directory of a run: it has neither deliveries, nor truth, nor streams/"
        )


def _order(stream: Stream) -> tuple[int, int, str, str]:
    number = int(stream.node) if stream.node.isdecimal() else 1 << 62
    return _KINDS.index(stream.kind), number, stream.node, stream.radio


class _Work:
    """One comparison: what was found so far bounds how far the next stream has to be read."""

    def __init__(
        self, run_a: Path, run_b: Path, until_ns: int, a_was_cut: bool, on_progress: OnProgress | None
    ) -> None:
        self.run_a, self.run_b = run_a, run_b
        self.first: Difference | None = None
        self.names: list[str] = []
        self.entries = 0
        self.ticks = 0
        self._has_truth = False
        self._limit_ns = self._until_ns = until_ns
        self._a_was_cut = a_was_cut
        self._on_progress = on_progress

    def take(self, name: str, found: Difference | None) -> None:
        """Keep the name of what was compared, and a difference if it comes before the one so far."""
        self.names.append(name)
        if found is not None and (self.first is None or found.tick_ns < self.first.tick_ns):
            self.first = found
            self._limit_ns = found.tick_ns - 1

    def _count(self, name: str, by: int = 1) -> None:
        before = self.entries // PROGRESS_ENTRIES
        self.entries += by
        if self._on_progress is not None and self.entries // PROGRESS_ENTRIES > before:
            self._on_progress(name, self.entries)

    def compare_table(self, table: Table) -> Difference | None:
        """The first difference within a table, up to the limit."""
        ticks = 0
        last_ns = -1

        def count(tick_ns: NDArray[np.int64]) -> None:
            nonlocal ticks, last_ns
            ticks += int(np.count_nonzero(np.diff(tick_ns, prepend=last_ns)))
            last_ns = int(tick_ns[-1])
            self._count(table.name, len(tick_ns))

        until_ns = None if self._limit_ns == NEVER_NS else self._limit_ns
        found = compare_table(
            self.run_a, self.run_b, table, until_ns, a_was_cut=self._a_was_cut, on_equal=count
        )
        if table is TRUTH:
            self.ticks, self._has_truth = ticks, ticks > 0
        return found

    def compare_stream(self, stream: Stream, in_a: set[Stream], in_b: set[Stream]) -> Difference | None:
        """The first difference within a stream, up to the limit."""
        if stream in in_a and stream in in_b:
            return self._walk(stream)
        if stream not in in_a and self._a_was_cut:
            return None
        run = self.run_a if stream in in_a else self.run_b
        entry = next(read_stream(stream.path(run)), None)
        if self._until_ns < NEVER_NS and (entry is None or entry.tick_ns > self._until_ns):
            return None
        has = (
            "a stream without entries"
            if entry is None
            else f"a stream that begins at {seconds(entry.tick_ns)}"
        )
        texts = (has, "no such stream") if stream in in_a else ("no such stream", has)
        return Difference(
            0 if entry is None else entry.tick_ns, stream.node, str(stream), "the stream", *texts
        )

    def _walk(self, stream: Stream) -> Difference | None:
        one = _Side(stream.path(self.run_a))
        other = _Side(stream.path(self.run_b))
        before, name, ticks, tick_ns = b"", str(stream), 0, -1
        while True:
            a, b = one.within(self._limit_ns), other.within(self._limit_ns)
            if a is None or b is None or a != b:
                break
            ticks, tick_ns = ticks + (a.tick_ns != tick_ns), a.tick_ns
            before = (before + a.payload)[-BEFORE_BYTES:]
            self._count(name)
            one.advance()
            other.advance()
        if not self._has_truth:  # units of modems, and exchanges between ticks, have instants of their own
            self.ticks = max(self.ticks, ticks)
        if (a is None and b is None) or (one.entry is None and self._a_was_cut):
            return None
        return _difference(stream, one, other, self._limit_ns, before)


class _Side:
    """One run's stream: the entry that is next."""

    def __init__(self, path: Path) -> None:
        self._entries: Iterator[Entry] = read_stream(path)
        self.last_ns: int | None = None
        self.entry = next(self._entries, None)

    def within(self, limit_ns: int) -> Entry | None:
        """The next entry, if there is one up to the limit."""
        return self.entry if self.entry is not None and self.entry.tick_ns <= limit_ns else None

    def advance(self) -> None:
        """Go to the entry after it."""
        if self.entry is not None:
            self.last_ns = self.entry.tick_ns
        self.entry = next(self._entries, None)

    def rest_of_tick(self, tick_ns: int) -> tuple[bytes, int]:
        """The bytes that remain of a tick, in one, and in how many entries they came."""
        joined, count = bytearray(), 0
        while (entry := self.within(tick_ns)) is not None and len(joined) <= TOGETHER_MAX_BYTES:
            joined += entry.payload
            count += 1
            self.advance()
        return bytes(joined), count


def _difference(stream: Stream, one: _Side, other: _Side, limit_ns: int, before: bytes) -> Difference:
    a, b = one.within(limit_ns), other.within(limit_ns)
    tick_ns = min(entry.tick_ns for entry in (a, b) if entry is not None)
    at = (tick_ns, stream.node, str(stream))
    if a is None or b is None or a.tick_ns != b.tick_ns:
        return _only_one(stream, one, other, tick_ns, before)
    if stream.kind not in _BYTE_STREAMS:
        return Difference(*at, *explain(stream.kind, a.payload, b.payload))
    (bytes_a, count_a), (bytes_b, count_b) = one.rest_of_tick(tick_ns), other.rest_of_tick(tick_ns)
    if bytes_a == bytes_b:
        return Difference(
            *at, "the entries", f"the same bytes, in {count_a}", f"the same bytes, in {count_b}"
        )
    return Difference(*at, *explain(stream.kind, bytes_a, bytes_b, before))


def _only_one(stream: Stream, one: _Side, other: _Side, tick_ns: int, before: bytes) -> Difference:
    """One side has an entry at this tick, the other goes on later or has ended."""
    texts, what = [], "the entry"
    for side in (one, other):
        if side.entry is None:
            what = "the stream"
            end = "is empty" if side.last_ns is None else f"ends with {seconds(side.last_ns)}"
            texts.append(f"{NOTHING}: the stream {end}")
        elif side.entry.tick_ns > tick_ns:
            texts.append(f"{NOTHING}: its next entry is at {seconds(side.entry.tick_ns)}")
        else:
            texts.append(describe(stream.kind, side.entry.payload, before))
    return Difference(tick_ns, stream.node, str(stream), what, *texts)
