"""What agents logged, as far as it is shown: the newest of each name, numbers over time, shapes.

Memory stays bounded, whatever they log.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostlink.view.picture.shapes import Shape, shape_of

NAMES_MAX = 64
"""Of a node; values under further names are counted only, unless they are shapes."""
SERIES_MAX = 64
"""Of a node; further numbers are shown, but not over time."""
POINTS_MAX = 600
"""Of a series; beyond it every second one is forgotten."""
SHAPES_MAX = 8
"""Of a node."""
TEXT_MAX = 160
ITEMS_SHOWN = 4
"""Of a vector."""


@dataclass(frozen=True, slots=True)
class Latest:
    """The newest value under a name: when it was logged, what it says, and what it is drawn as."""

    sim_time_ns: int
    text: str
    shape: Shape | None


class Series:
    """One number over sim time, thinned so that memory stays bounded; the newest is always there."""

    def __init__(self) -> None:
        self._time_s, self._value = array("d"), array("d")
        self._every, self._skipped = 1, 0
        self._newest: tuple[float, float] | None = None

    def add(self, time_s: float, value: float) -> None:
        """Add a value."""
        self._newest = (time_s, value)
        self._skipped += 1
        if self._skipped < self._every:
            return
        self._skipped, self._newest = 0, None
        self._time_s.append(time_s)
        self._value.append(value)
        if len(self._time_s) >= POINTS_MAX:
            self._time_s, self._value = self._time_s[1::2], self._value[1::2]
            self._every *= 2

    def points(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return sim time, s, and values, shape (T,) each."""
        times, values = self._time_s.tolist(), self._value.tolist()
        if self._newest is not None:
            times.append(self._newest[0])
            values.append(self._newest[1])
        return np.array(times), np.array(values)


class Logged:
    """What the agents of ``nodes`` logged."""

    def __init__(self, nodes: Sequence[str]) -> None:
        self.latest: dict[str, dict[str, Latest]] = {node: {} for node in nodes}
        """By node and name."""
        self.series: dict[str, dict[str, Series]] = {node: {} for node in nodes}
        """By node and what `numbers_of` calls them."""
        self.passed_over: Counter[str] = Counter()
        """Values by node that are not shown: it has too many names."""
        self.shapes: dict[tuple[str, str], tuple[int, Shape | None]] = {}
        """By node and name: number of its change, and what it is now; the newest change comes last."""
        self.changes = 0
        """Of shapes."""

    def take(self, node: str, name: str, sim_time_ns: int, value: Any) -> None:
        """Take a value, whatever it is."""
        known = self.latest.get(node)
        if known is None:
            return
        shape = shape_of(value)
        if name not in known and len(known) >= NAMES_MAX + (SHAPES_MAX if shape else 0):
            self.passed_over[node] += 1
            return
        shape = self._draw(node, name, shape)
        known[name] = Latest(sim_time_ns, described(value), shape)
        series = self.series[node]
        for label, number in numbers_of(name, value):
            if label in series or len(series) < SERIES_MAX:
                series.setdefault(label, Series()).add(sim_time_ns / 1e9, number)

    def _draw(self, node: str, name: str, shape: Shape | None) -> Shape | None:
        key = node, name
        _, before = self.shapes.get(key, (0, None))
        if shape == before:
            return before
        if before is None and sum(1 for n, (_, s) in self.shapes.items() if n[0] == node and s) >= SHAPES_MAX:
            return None
        self.changes += 1
        self.shapes.pop(key, None)
        self.shapes[key] = (self.changes, shape)
        return shape


def numbers_of(name: str, value: Any) -> Iterator[tuple[str, float]]:
    """What of a value can be charted, with labels: a number, or those in a mapping; NaN for one that is not finite."""
    if isinstance(value, dict):
        for key, item in value.items():
            if isinstance(item, int | float) or item is None:
                yield f"{name}: {key}", _finite(item)
    elif isinstance(value, int | float) or value is None:
        yield name, _finite(value)


def _finite(value: float | None) -> float:
    try:
        number = math.nan if value is None else float(value)
    except OverflowError:
        return math.nan
    return number if math.isfinite(number) else math.nan


def described(value: Any) -> str:
    """A value in words, cut where it gets long."""
    items = value.items() if isinstance(value, dict) else ()
    text = ", ".join(f"{key} {_item(item)}" for key, item in items) if items else _item(value)
    return text if len(text) <= TEXT_MAX else f"{text[: TEXT_MAX - 3]}..."


def _item(value: Any) -> str:
    match value:
        case None:
            return "-"
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value:.6g}"
        case list():
            more = f", ... ({len(value)})" if len(value) > ITEMS_SHOWN else ""
            return f"[{', '.join(_scalar(item) for item in value[:ITEMS_SHOWN])}{more}]"
    return _scalar(value)


def _scalar(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    return "..." if value and isinstance(value, list | dict) else str(value)[:TEXT_MAX]
