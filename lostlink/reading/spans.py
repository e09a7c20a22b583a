"""Spans of distance: the rows of a table for people, however far a flight goes."""

from __future__ import annotations

from collections.abc import Iterable

ROWS_MAX = 40


def spans_of(bins: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Where each row begins and ends, m, given the same of the bins: each a row, or of many 2, 4, 8, ... in one."""
    spans = sorted(set(bins))
    while len(spans) > ROWS_MAX:
        width_m = 2.0 * (spans[0][1] - spans[0][0])
        starts_m = sorted({start_m // width_m * width_m for start_m, _ in spans})
        spans = [(start_m, start_m + width_m) for start_m in starts_m]
    return spans
