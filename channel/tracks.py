"""Where every node was: truth samples, interpolated linearly between the two that stand around an instant."""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from channel import checks
from channel.checks import ChannelInputError, FloatArray

POSITION = slice(0, 3)
VELOCITY = slice(3, 6)
ATTITUDE = slice(6, 10)
COLUMNS = 10
LEVEL_WXYZ = (1.0, 0.0, 0.0, 0.0)
KEPT_SAMPLES = 1024
"""Per node; twice as many are held before the older half goes."""
NEVER = -(2**62)
FOREVER = 2**62


class Tracks:
    """The recent truth of a fixed set of nodes, in one common north-east-down frame.

    `frontier_ns` is the latest instant at which every node that still reports is known.

    Args:
        nodes: names, in the order of the rows that `rows_at` returns.
        max_age_ns: a node whose newest truth is older than the newest of all by more than this is taken to
            stand where it was last seen.
    """

    def __init__(self, nodes: Sequence[str], max_age_ns: int) -> None:
        self.index = {node: i for i, node in enumerate(nodes)}
        self._max_age_ns = max_age_ns
        self._times: list[list[int]] = [[] for _ in nodes]
        self._rows: list[list[FloatArray]] = [[] for _ in nodes]
        self._newest = [NEVER] * len(nodes)
        self._first_ns: int | None = None
        self._newest_ns = NEVER
        self.frontier_ns = NEVER
        self._valid = (1, 0)
        self._base = np.zeros((len(nodes), COLUMNS))
        self._change = np.zeros_like(self._base)
        self._start_ns = np.zeros(len(nodes))
        self._per_ns = np.zeros(len(nodes))
        self.all_known = False
        self.known: NDArray[np.bool_] = np.zeros(len(nodes), dtype=bool)

    def observe(self, node: int, sim_time_ns: int, row: FloatArray) -> bool:
        """Take in one truth sample; one that is not newer than the node's newest is left out.

        Returns:
            Whether the frontier moved.
        """
        times, rows = self._times[node], self._rows[node]
        if self._newest[node] == FOREVER or (times and sim_time_ns <= times[-1]):
            return False
        if rows and float(row[ATTITUDE] @ rows[-1][ATTITUDE]) < 0.0:
            row[ATTITUDE] *= -1.0
        if not times:
            self._valid = (1, 0)
        times.append(sim_time_ns)
        rows.append(row)
        if len(times) > 2 * KEPT_SAMPLES:
            del times[:KEPT_SAMPLES], rows[:KEPT_SAMPLES]
        was_newest, self._newest[node] = self._newest[node], sim_time_ns
        return self._advance(was_newest, sim_time_ns)

    def place(self, node: int, row: FloatArray) -> bool:
        """Put a node where it stays for good; return whether the frontier moved."""
        self._times[node], self._rows[node] = [0], [row]
        self._newest[node] = FOREVER
        self._valid = (1, 0)
        return self._advance(NEVER, NEVER)

    def finish(self) -> None:
        """Move the frontier beyond everything: what is known now is all there will be."""
        self.frontier_ns = FOREVER
        self._valid = (1, 0)

    def _advance(self, was_newest: int, now_newest: int) -> bool:
        if self._first_ns is None and now_newest != NEVER:
            self._first_ns = now_newest
        self._newest_ns = max(self._newest_ns, now_newest)
        horizon = self._newest_ns - self._max_age_ns
        if was_newest > self.frontier_ns >= horizon:
            return False  # another node is the one to wait for, and it is not too old
        unseen_count = self._first_ns is None or self._first_ns >= horizon
        waited_for = [t for t in self._newest if t >= horizon or (t == NEVER and unseen_count)]
        frontier = min(waited_for, default=NEVER)
        moved = frontier > self.frontier_ns
        self.frontier_ns = max(self.frontier_ns, frontier)
        return moved

    def rows_at(self, sim_time_ns: int) -> FloatArray:
        """Return position, velocity and attitude of every node, shape (nodes, 10); `known` says which mean it.

        Before a node's first sample it stands at it, after its last sample at that.
        """
        if not self._valid[0] <= sim_time_ns <= self._valid[1]:
            self._bracket(sim_time_ns)
        weight = (sim_time_ns - self._start_ns) * self._per_ns
        return self._base + weight[:, np.newaxis] * self._change

    def _bracket(self, sim_time_ns: int) -> None:
        """Find the samples around an instant for each node, and from when to when they stay the right ones."""
        low, high = NEVER, FOREVER
        for node, (times, rows) in enumerate(zip(self._times, self._rows, strict=True)):
            after = bisect.bisect_left(times, sim_time_ns)
            self.known[node] = bool(times)
            self._start_ns[node], self._per_ns[node] = 0.0, 0.0
            if not times:
                continue
            if self._newest[node] == FOREVER:
                self._base[node], self._change[node] = rows[0], 0.0
            elif 0 < after < len(times):
                start, end = times[after - 1], times[after]
                self._base[node], self._change[node] = rows[after - 1], rows[after] - rows[after - 1]
                self._start_ns[node], self._per_ns[node] = start, 1.0 / (end - start)
                low, high = max(low, start + 1), min(high, end)
            else:
                self._base[node] = rows[min(after, len(rows) - 1)]
                self._change[node] = 0.0
                low, high = (low, min(high, times[0])) if after == 0 else (sim_time_ns, sim_time_ns)
        self._valid = (low, high)
        self.all_known = bool(self.known.all())


def truth_row(
    position_ned_m: ArrayLike, attitude_wxyz: ArrayLike | None, velocity_ned_mps: ArrayLike | None
) -> FloatArray:
    """Return one checked truth sample as a row of 10 numbers.

    Raises:
        ChannelInputError: a wrong shape, a value that is not finite, or a quaternion of no length.
    """
    row = np.zeros(COLUMNS)
    row[POSITION] = checks.vectors("position_ned_m", position_ned_m, 3)
    row[ATTITUDE] = LEVEL_WXYZ
    if velocity_ned_mps is not None:
        row[VELOCITY] = checks.vectors("velocity_ned_mps", velocity_ned_mps, 3)
    if attitude_wxyz is not None:
        attitude = checks.vectors("attitude_wxyz", attitude_wxyz, 4)
        length = math.sqrt(float(attitude @ attitude))
        if not 0.5 < length < 2.0:
            raise ChannelInputError("attitude_wxyz", attitude.tolist(), "a quaternion of length about 1")
        row[ATTITUDE] = attitude / length
    return row
