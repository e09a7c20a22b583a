"""Where every node was: truth samples, interpolated linearly between the two that stand around an instant."""

from __future__ import annotations

from typing import NamedTuple

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
FIRST_SAMPLES = 8
STEPS_BACK = 3
"""So many samples back are looked at for all nodes together, before each node is searched."""
NEVER = -(2**62)
FOREVER = 2**62

Times = NDArray[np.int64]
Indices = NDArray[np.intp]


class Snapshot(NamedTuple):
    """Where all nodes were at some instants; each column is instant * nodes + node.

    Attributes:
        position_ned_m: shape (3, instants * nodes).
        attitude_wxyz: shape (4, instants * nodes), of length 1; None if it was not asked for.
        velocity_ned_mps: shape (3, instants * nodes); None if it was not asked for.
    """

    position_ned_m: FloatArray
    attitude_wxyz: FloatArray | None
    velocity_ned_mps: FloatArray | None


class _Spans(NamedTuple):
    """The samples before and after instants, of all nodes; both are the same one where a node stands.

    Attributes:
        low_ns: the spans hold for instants after it ...
        high_ns: ... and up to this one.
        start_ns: of the earlier samples, shape (instants, nodes).
        per_ns: 1 over the length of the span, 0 of a node that stands.
        base: the earlier samples, shape (columns, instants, nodes).
        change: from there to the later ones.
    """

    low_ns: int
    high_ns: int
    start_ns: Times
    per_ns: FloatArray
    base: FloatArray
    change: FloatArray


NO_SPANS = _Spans(FOREVER, NEVER, np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0), np.zeros(0))


class Tracks:
    """The recent truth of a fixed set of nodes, in one common north-east-down frame.

    Args:
        count: how many nodes.
        max_age_ns: a node whose newest truth is older than the newest of all by more than this is taken to
            stand where it was last seen.
        ahead_ns: for so long a node goes on as it last moved beyond its newest truth; 0: it stands there.

    Attributes:
        known: which nodes were ever seen, shape (nodes,).
        all_known: whether all of them were.
    """

    def __init__(self, count: int, max_age_ns: int, ahead_ns: int = 0) -> None:
        self._max_age_ns = max_age_ns
        self._ahead_ns = ahead_ns
        self._nodes = np.arange(count)
        self._first = self._nodes * FIRST_SAMPLES
        self._held = np.zeros(count, dtype=np.intp)
        self._times = np.zeros((count, FIRST_SAMPLES), dtype=np.int64)
        self._rows = np.zeros((COLUMNS, count, FIRST_SAMPLES))
        self._newest = np.full(count, NEVER, dtype=np.int64)
        self._first_ns: int | None = None
        self._newest_ns = NEVER
        self._frontier_ns = NEVER
        self._moved = False
        self._spans = NO_SPANS
        self.known = np.zeros(count, dtype=bool)
        self.all_known = False

    def observe(self, nodes: Indices, sim_time_ns: Times | int, rows: FloatArray) -> None:
        """Take in one truth sample of each of some nodes; one that is not newer than the node's newest is left out.

        Args:
            nodes: which, each once.
            sim_time_ns: when, one for all or one each.
            rows: position and attitude, shape (nodes, 7).
        """
        times = np.broadcast_to(sim_time_ns, nodes.shape)
        newer = times > self._newest[nodes]
        if not newer.all():
            nodes, times, rows = nodes[newer], times[newer], rows[newer]
            if not nodes.size:
                return
        if int(self._held[nodes].max()) == self._times.shape[1]:
            self._make_room()
        at = self._held[nodes]
        self._times[nodes, at] = times
        self._rows[:, nodes, at] = _nearer(rows.T, self._rows[:, nodes, np.maximum(at - 1, 0)])
        self._held[nodes] = at + 1
        self._newest[nodes] = times
        if self._first_ns is None:
            self._first_ns = int(times[0])
        self._newest_ns = max(self._newest_ns, int(times.max()))
        self._changed(nodes)

    def place(self, node: int, row: FloatArray) -> None:
        """Put a node where it stays for good."""
        self._times[node, 0], self._rows[:, node, 0], self._held[node] = 0, row, 1
        self._newest[node] = FOREVER
        self._changed(node)

    def _changed(self, nodes: Indices | int) -> None:
        self._moved, self._spans = True, NO_SPANS
        if not self.all_known:
            self.known[nodes] = True
            self.all_known = bool(self.known.all())

    def _make_room(self) -> None:
        """Double the samples that can be held, or drop the older half of those of each node that has its fill."""
        held = self._times.shape[1]
        if held < 2 * KEPT_SAMPLES:
            self._first = self._nodes * (2 * held)
            self._times = np.concatenate((self._times, np.zeros_like(self._times)), axis=1)
            self._rows = np.concatenate((self._rows, np.zeros_like(self._rows)), axis=2)
            return
        full = np.flatnonzero(self._held == held)
        self._times[full, : held // 2] = self._times[full, held // 2 :]
        self._rows[:, full, : held // 2] = self._rows[:, full, held // 2 :]
        self._held[full] = held // 2

    def frontier_ns(self) -> int:
        """Return the latest instant at which every node that still reports is known; it never goes back."""
        if self._moved:
            self._moved = False
            horizon = self._newest_ns - self._max_age_ns
            waited_for = self._newest >= horizon
            if self._first_ns is None or self._first_ns >= horizon:
                waited_for |= self._newest == NEVER
            frontier = int(np.min(self._newest, initial=FOREVER, where=waited_for))
            self._frontier_ns = max(self._frontier_ns, frontier if waited_for.any() else NEVER)
        return self._frontier_ns

    def at(self, instants_ns: Times, *, attitude: bool = False, velocity: bool = False) -> Snapshot:
        """Return where all nodes were at some instants.

        Before a node's first sample it stands at it, after its last sample at that, unless it goes on for a while
        (``ahead_ns``); a node never seen is at 0. Its velocity is the slope of the line that it moves along: at a
        sample the slope up to there, 0 while it stands.

        Args:
            instants_ns: shape (U,), rising.
            attitude: whether attitudes are wanted.
            velocity: whether velocities are.
        """
        spans = self._spans
        if not spans.low_ns < instants_ns[0] <= instants_ns[-1] <= spans.high_ns:
            spans = self._spans_at(instants_ns)
        columns = slice(0, COLUMNS) if attitude else POSITION
        weight = (instants_ns[:, np.newaxis] - spans.start_ns) * spans.per_ns
        if self._ahead_ns:
            weight = np.minimum(weight, 1.0 + self._ahead_ns * spans.per_ns)
        moved = (spans.base[columns] + weight * spans.change[columns]).reshape(-1, weight.size)
        speed = None
        if velocity:
            per_second = spans.change[POSITION] * (spans.per_ns * NS_PER_S)
            speed = np.broadcast_to(per_second, (3, *weight.shape)).reshape(3, weight.size)
        return Snapshot(moved[POSITION], _unit(moved[ATTITUDE]) if attitude else None, speed)

    def _spans_at(self, instants_ns: Times) -> _Spans:
        """Return the spans of all nodes around instants; if they are the same for all of these, they are kept."""
        after = self._after(instants_ns)
        shared = len(after) == 1 or bool((after == after[0]).all())
        if shared:
            after = after[:1]
        inside, begun = after < self._held, after > 0
        moving = inside & begun
        if self._ahead_ns:
            moving |= ~inside & (self._held > 1)
        right = self._first + np.minimum(after, np.maximum(self._held - 1, 0))
        left = right - moving
        shape = (COLUMNS, *after.shape)
        base = self._rows.reshape(COLUMNS, -1).take(left, axis=1).reshape(shape)
        change = self._rows.reshape(COLUMNS, -1).take(right, axis=1).reshape(shape) - base
        start_ns, end_ns = self._times.take(left), self._times.take(right)
        per_ns = moving / np.maximum(end_ns - start_ns, 1)
        low_ns = np.where(begun, start_ns, NEVER).max()
        high_ns = np.where(inside, end_ns, FOREVER).min()
        spans = _Spans(int(low_ns), int(high_ns), start_ns, per_ns, base, change)
        if shared:
            self._spans = spans
        return spans

    def _after(self, instants_ns: Times) -> Indices:
        """Return how many samples of each node are older than each instant, shape (instants, nodes)."""
        times = instants_ns[:, np.newaxis]
        after = np.empty((len(instants_ns), len(self._held)), dtype=np.intp)
        after[:] = self._held
        for _ in range(STEPS_BACK):
            back = self._not_older(times, after)
            if not np.count_nonzero(back):
                return after
            after -= back
        for node in np.flatnonzero(self._not_older(times, after).any(axis=0)).tolist():
            held = self._times[node, : self._held[node]]
            after[:, node] = np.searchsorted(held, instants_ns, side="left")
        return after

    def _not_older(self, times: Times, after: Indices) -> NDArray[np.bool_]:
        """Return where the last of so many samples of a node is not older than an instant."""
        last = self._times.take(self._first + np.maximum(after - 1, 0))
        return (last >= times) & (after > 0)


def _nearer(rows: FloatArray, previous: FloatArray) -> FloatArray:
    """Return samples, shape (columns, nodes), with their quaternions in the sign that is nearer to those before."""
    product = rows[ATTITUDE] * previous[ATTITUDE]
    away = product[0] + product[1] + product[2] + product[3] < 0.0
    if away.any():
        rows = rows.copy()
        rows[ATTITUDE, away] *= -1.0
    return rows


def _unit(quaternion: FloatArray) -> FloatArray:
    """Return interpolated attitudes, shape (4, ...), at length 1; a node never seen is level."""
    length = np.sqrt(np.sum(quaternion * quaternion, axis=0))
    level = np.array(LEVEL_WXYZ)[:, np.newaxis]
    return np.where(length > 0.0, quaternion / np.maximum(length, 1e-9), level)


def truth_rows(position_ned_m: ArrayLike, attitude_wxyz: ArrayLike | None) -> FloatArray:
    """Return checked truth samples, shape (..., 7).

    Raises:
        ChannelInputError: a wrong shape, a value that is not finite, or a quaternion of no length.
    """
    position = checks.vectors("position_ned_m", position_ned_m, 3)
    rows = np.empty((*position.shape[:-1], COLUMNS))
    rows[..., POSITION] = position
    if attitude_wxyz is None:
        rows[..., ATTITUDE] = LEVEL_WXYZ
        return rows
    attitude = checks.vectors("attitude_wxyz", attitude_wxyz, 4)
    length = np.sqrt(np.sum(attitude * attitude, axis=-1, keepdims=True))
    good = (length > 0.5) & (length < 2.0)
    if not good.all():
        bad = attitude[~good[..., 0]].reshape(-1, 4)[0].tolist()
        raise ChannelInputError("attitude_wxyz", bad, "a quaternion of length about 1")
    rows[..., ATTITUDE] = attitude / length
    return rows
