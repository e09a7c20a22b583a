"""Where every node was: truth samples, interpolated linearly between the two that stand around an instant."""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from channel import checks
from channel.checks import ChannelInputError, FloatArray

POSITION = slice(0, 3)
ATTITUDE = slice(3, 7)
COLUMNS = 7
LEVEL_WXYZ = (1.0, 0.0, 0.0, 0.0)
NS_PER_S = 1e9
KEPT_SAMPLES = 1024
"""Per node; twice as many are held before the older half goes."""
NEVER = -(2**62)
FOREVER = 2**62

Row = tuple[float, ...]
"""One truth sample: position, attitude."""

Arrays = tuple[int | NDArray[np.int64], float | FloatArray, FloatArray, FloatArray]
"""Of all nodes: start of the span, 1 / its length in ns, first sample, change up to the second."""


class Span(NamedTuple):
    """The samples before and after an instant; both are the same one where the node stands."""

    start_ns: int
    per_ns: float
    before: Row
    after: Row


NOWHERE = Span(0, 0.0, (0.0,) * COLUMNS, (0.0,) * COLUMNS)


class Tracks:
    """The recent truth of a fixed set of nodes, in one common north-east-down frame.

    `frontier_ns` is the latest instant at which every node that still reports is known.

    Args:
        nodes: names, in the order in which `columns_at` returns them.
        max_age_ns: a node whose newest truth is older than the newest of all by more than this is taken to
            stand where it was last seen.
    """

    def __init__(self, nodes: Sequence[str], max_age_ns: int) -> None:
        self.index = {node: i for i, node in enumerate(nodes)}
        self._max_age_ns = max_age_ns
        self._times: list[list[int]] = [[] for _ in nodes]
        self._rows: list[list[Row]] = [[] for _ in nodes]
        self._newest = [NEVER] * len(nodes)
        self._first_ns: int | None = None
        self._newest_ns = NEVER
        self.frontier_ns = NEVER
        self._at_frontier = 0
        self._valid = (1, 0)
        self._spans = [NOWHERE] * len(nodes)
        self._arrays: Arrays | None = None
        self.known = [False] * len(nodes)
        self.all_known = False

    def observe(self, node: int, sim_time_ns: int, row: Row) -> bool:
        """Take in one truth sample; one that is not newer than the node's newest is left out.

        Returns:
            Whether the frontier moved.
        """
        times, rows = self._times[node], self._rows[node]
        was_newest = self._newest[node]
        if sim_time_ns <= was_newest:
            return False
        if rows:
            row = _nearer(row, rows[-1])
        else:
            self._valid = (1, 0)
        times.append(sim_time_ns)
        rows.append(row)
        if len(times) > 2 * KEPT_SAMPLES:
            del times[:KEPT_SAMPLES], rows[:KEPT_SAMPLES]
        self._newest[node] = sim_time_ns
        return self._advance(was_newest, sim_time_ns)

    def place(self, node: int, row: Row) -> bool:
        """Put a node where it stays for good; return whether the frontier moved."""
        self._times[node], self._rows[node] = [0], [row]
        self._newest[node] = FOREVER
        self._valid = (1, 0)
        self._at_frontier = 0
        return self._advance(NEVER, NEVER)

    def _advance(self, was_newest: int, now_newest: int) -> bool:
        """Move the frontier on if the node was the last one, or too old to wait for."""
        if self._first_ns is None and now_newest != NEVER:
            self._first_ns = now_newest
        self._newest_ns = max(self._newest_ns, now_newest)
        horizon = self._newest_ns - self._max_age_ns
        self._at_frontier -= was_newest == self.frontier_ns
        if self._at_frontier > 0 and self.frontier_ns >= horizon:
            return False  # another node is the one to wait for, and it is not too old
        unseen_count = self._first_ns is None or self._first_ns >= horizon
        waited_for = [t for t in self._newest if t >= horizon or (t == NEVER and unseen_count)]
        frontier = min(waited_for, default=NEVER)
        moved = frontier > self.frontier_ns
        self.frontier_ns = max(self.frontier_ns, frontier)
        self._at_frontier = waited_for.count(self.frontier_ns)
        return moved

    def columns_at(self, sim_time_ns: int, columns: int = COLUMNS) -> FloatArray:
        """Return position and attitude of every node, or the first columns of these.

        Before a node's first sample it stands at it, after its last sample at that; `known` says whether there
        is one.

        Returns:
            Shape (columns, nodes).
        """
        start_ns, per_ns, base, change = self._arrays_at(sim_time_ns)
        weight = (max(-FOREVER, min(sim_time_ns, FOREVER)) - start_ns) * per_ns  # numpy counts to 2^63
        moved: FloatArray = base[:columns] + weight * change[:columns]
        return moved

    def velocities_at(self, sim_time_ns: int) -> FloatArray:
        """Return the velocity of every node in m/s, shape (3, nodes): the slope of the line that it moves along.

        At a sample it is the slope up to there; a node that stands (before its first sample, after its last, placed
        for good) has none.
        """
        _, per_ns, _, change = self._arrays_at(sim_time_ns)
        velocity_ned_mps: FloatArray = change[POSITION] * (per_ns * NS_PER_S)
        return velocity_ned_mps

    def _arrays_at(self, sim_time_ns: int) -> Arrays:
        """Return what the spans around an instant are as arrays."""
        if not self._valid[0] <= sim_time_ns <= self._valid[1]:
            self._bracket(sim_time_ns)
        if self._arrays is None:
            self._arrays = _arrays(self._spans)
        return self._arrays

    def _bracket(self, sim_time_ns: int) -> None:
        """Find the samples around an instant for each node, and from when to when they stay the right ones."""
        low, high = NEVER, FOREVER
        for node, (times, rows) in enumerate(zip(self._times, self._rows, strict=True)):
            if not times:
                continue
            self.known[node] = True
            after = bisect.bisect_left(times, sim_time_ns)
            if 0 < after < len(times):
                start, end = times[after - 1], times[after]
                self._spans[node] = Span(start, 1.0 / (end - start), rows[after - 1], rows[after])
                low, high = max(low, start + 1), min(high, end)
                continue
            row = rows[min(after, len(rows) - 1)]
            self._spans[node] = Span(0, 0.0, row, row)
            if self._newest[node] != FOREVER:
                low, high = (low, min(high, times[0])) if after == 0 else (sim_time_ns, sim_time_ns)
        self._valid, self._arrays = (low, high), None
        self.all_known = all(self.known)


def _arrays(spans: Sequence[Span]) -> Arrays:
    """Return starts and rates, each one number if all that move share it, first samples and changes."""
    base = np.array([span.before for span in spans]).T.copy()
    change = np.array([span.after for span in spans]).T - base
    moving = {(span.start_ns, span.per_ns) for span in spans if span.per_ns > 0.0}
    if len(moving) <= 1:
        start_ns, per_ns = moving.pop() if moving else (0, 0.0)
        return start_ns, per_ns, base, change
    starts = np.array([span.start_ns for span in spans], dtype=np.int64)
    return starts, np.array([span.per_ns for span in spans]), base, change


def _nearer(row: Row, previous: Row) -> Row:
    """Return the sample with its quaternion in the sign that is nearer to the one before it."""
    w, x, y, z = previous[ATTITUDE]
    if row[3] * w + row[4] * x + row[5] * y + row[6] * z >= 0.0:
        return row
    return (*row[:3], -row[3], -row[4], -row[5], -row[6])


def truth_row(position_ned_m: ArrayLike, attitude_wxyz: ArrayLike | None) -> Row:
    """Return one checked truth sample.

    Raises:
        ChannelInputError: a wrong shape, a value that is not finite, or a quaternion of no length.
    """
    position = _numbers("position_ned_m", position_ned_m, 3)
    if attitude_wxyz is None:
        return (*position, *LEVEL_WXYZ)
    w, x, y, z = _numbers("attitude_wxyz", attitude_wxyz, 4)
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not 0.5 < length < 2.0:
        raise ChannelInputError("attitude_wxyz", [w, x, y, z], "a quaternion of length about 1")
    return (*position, w / length, x / length, y / length, z / length)


def _numbers(name: str, value: ArrayLike, size: int) -> Row:
    """Return a vector as a tuple of finite numbers; a tuple of them is taken as it is, at little cost."""
    if isinstance(value, tuple) and len(value) == size and all(type(each) is float for each in value):
        numbers = cast(Row, value)
        if math.isfinite(sum(numbers)):
            return numbers
    vector = checks.vectors(name, value, size)
    if vector.ndim != 1:
        raise ChannelInputError(name, f"array of shape {vector.shape}", f"shape ({size},)")
    return tuple(vector.tolist())
