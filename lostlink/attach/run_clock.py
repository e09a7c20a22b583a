"""The clock of a run as somebody sees it who lives in wall time. No I/O, no clock of its own."""

from __future__ import annotations

from math import inf, isinf
from typing import Final

SLOW: Final = 0.99
"""A run that reaches less than this share of its speed is too slow for what a program measures."""


class RunClock:
    """Which wall time belongs to an instant of sim time, and whether the run keeps up.

    Attributes:
        speed: sim time by wall time, as it is asked for.
    """

    def __init__(self) -> None:
        self.speed = inf
        self._tick_ns, self._at_s = 0, -inf
        self._first: tuple[int, float] | None = None

    def came(self, tick_ns: int, at_s: float, speed: float) -> None:
        """Take a tick that came at ``at_s`` of wall time."""
        self._tick_ns, self._at_s, self.speed = tick_ns, at_s, speed
        if self._first is None:
            self._first = tick_ns, at_s

    def wall_s(self, sim_time_ns: int) -> float:
        """When an instant is, counted from the newest tick; what is past is due."""
        return self._at_s + max(0, sim_time_ns - self._tick_ns) / 1e9 / self.speed

    @property
    def factor(self) -> float | None:
        """How fast the run has gone, sim time by wall time; None before two ticks."""
        if self._first is None or self._tick_ns == self._first[0]:
            return None
        return (self._tick_ns - self._first[0]) / 1e9 / max(self._at_s - self._first[1], 1e-9)

    @property
    def warning(self) -> str:
        """What to say of a run that did not keep up with its speed; "" if it did."""
        if self.factor is None or isinf(self.speed) or self.factor >= SLOW * self.speed:
            return ""
        return (
            f"warning: the run went at {self.factor:.2f} times real time, and {self.speed:g} was asked for: rates and "
            "delays that the program measured are off by as much; the record is right"
        )
