"""Which of two ways is faster, tried alternately. Sans-IO: sim time and wall instants in, the way to go on in out."""

from __future__ import annotations

from statistics import median

WINDOW_NS = 100_000_000
"""Wall time of one measure."""
SETTLE_NS = 10_000_000
"""Wall time after a change that is not measured."""
WINDOW_MAX_NS = 5 * WINDOW_NS
"""A measure that took longer was held up by something else, and is taken again."""
PAIRS = 9
"""Measures of each way."""
GAIN = 1.15
"""The second way is taken if it is so much faster in the median, and faster in all pairs but one. Beside other jobs
single measures differ by more, and two ways that are alike pass that once in fifty times."""


class Trial:
    """Measures sim time per wall time in the first way and the second alternately, and then decides for good.

    Attributes:
        second: the second way is to be used now.
        done: that stays so.
    """

    def __init__(self) -> None:
        self.second = self.done = False
        self._from: tuple[int, int] | None = None
        self._settled_ns: int | None = None
        self._first_rate = 0.0
        self._gains: list[float] = []

    def at(self, sim_time_ns: int, wall_ns: int) -> None:
        """Sim time is `sim_time_ns` at the instant `wall_ns` (monotonic)."""
        if self.done:
            return
        if self._settled_ns is None:
            self._settled_ns = wall_ns + SETTLE_NS
        elif self._from is None:
            if wall_ns >= self._settled_ns:
                self._from = (sim_time_ns, wall_ns)
        elif wall_ns - self._from[1] >= WINDOW_NS:
            self._measured(sim_time_ns - self._from[0], wall_ns - self._from[1])
            self._from = self._settled_ns = None

    def restart(self) -> None:
        """What was begun does not count: begin this measure anew."""
        self._from = self._settled_ns = None

    def _measured(self, sim_ns: int, wall_ns: int) -> None:
        if wall_ns > WINDOW_MAX_NS or sim_ns <= 0:
            return
        if not self.second:
            self._first_rate, self.second = sim_ns / wall_ns, True
            return
        self._gains.append(sim_ns / wall_ns / self._first_rate)
        self.done = len(self._gains) == PAIRS
        self.second = self.done and self._pays()

    def _pays(self) -> bool:
        return median(self._gains) >= GAIN and sum(gain > 1.0 for gain in self._gains) >= PAIRS - 1
