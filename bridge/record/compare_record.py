"""The first line in which two `deliveries.csv` differ."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from bridge.record.difference import Difference
from bridge.record.explain import NOTHING
from bridge.record.names import RECORD, RECORD_FILE

LINE_MAX_BYTES = 1 << 16


class _Line(NamedTuple):
    number: int
    raw: bytes

    @property
    def tick_ns(self) -> int | None:
        """Its first column, if that is a number."""
        first = self.raw.split(b",", 1)[0]
        return int(first) if first.isdigit() and len(first) < 20 else None

    @property
    def text(self) -> str:
        return self.raw.decode("utf-8", "replace").rstrip("\r\n")


def compare_record(
    run_a: Path, run_b: Path, until_ns: int | None, *, a_was_cut: bool, count: Callable[[], object]
) -> Difference | None:
    """The first line that differs; None if there is none.

    Args:
        run_a: the first run's directory.
        run_b: the second run's.
        until_ns: pass over packets that were sent later.
        a_was_cut: the first run was killed: its record may end early, and within a line.
        count: called for every line that is equal.

    Raises:
        OSError: a file cannot be read.
    """
    paths = [run / RECORD_FILE for run in (run_a, run_b)]
    if not all(path.exists() for path in paths):
        if a_was_cut and not paths[0].exists():
            return None
        texts = ("the record" if path.exists() else f"no {RECORD_FILE}" for path in paths)
        return Difference(0, "", RECORD, "the stream", *texts)
    one, other = (_lines(path, until_ns) for path in paths)
    tick_ns = 0
    while True:
        a, b = next(one, None), next(other, None)
        if a is None and b is None:
            return None
        if a_was_cut and (a is None or not a.raw.endswith(b"\n")):
            return None
        if a is None or b is None or a.raw != b.raw:
            return _difference(a, b, tick_ns)
        tick_ns = a.tick_ns or tick_ns
        count()


def _lines(path: Path, until_ns: int | None) -> Iterator[_Line]:
    number = 1
    with path.open("rb") as file:
        while raw := file.readline(LINE_MAX_BYTES):
            line = _Line(number, raw)
            if until_ns is None or (line.tick_ns or 0) <= until_ns:
                yield line
            number += raw.endswith(b"\n")


def _difference(a: _Line | None, b: _Line | None, before_ns: int) -> Difference:
    present = [line for line in (a, b) if line is not None]
    ticks = [line.tick_ns for line in present if line.tick_ns is not None]
    columns = present[0].text.split(",")
    node = columns[1] if ticks and len(columns) > 1 else ""
    numbers = sorted({line.number for line in present})
    texts = (line.text if line is not None else f"{NOTHING}: the record ends" for line in (a, b))
    what = f"line {' and '.join(map(str, numbers))}"
    return Difference(min(ticks, default=before_ns), node, RECORD, what, *texts)
