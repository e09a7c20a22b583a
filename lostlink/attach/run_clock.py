"""The clock of a run as somebody sees it who lives in wall time. No I/O, no clock of its own."""

from __future__ import annotations

from math import inf
from typing import Final

SLOW: Final = 0.99
"""A run that reaches less than this share of its speed is too slow for what a program measures ..."""
BEHIND_S: Final = 0.2
"""... if it is as far behind: a tick that comes late by less says nothing of the run's speed."""


class RunClock:
    """Which wall time belongs to an instant of sim time, and whether the run keeps up.

    Whether it does is seen between ticks with the same speed, of 1 or another; not while an operator holds the clock,
    nor between two ticks between which one did something to it.

    Attributes:
        speed: sim time by wall time, as it is asked for.
    """

    def __init__(self) -> None:
        self.speed = inf
        self._tick_ns, self._at_s = 0, -inf
        self._is_held, self._is_steady = False, False
        self._due_s, self._took_s = 0.0, 0.0

    def came(self, tick_ns: int, at_s: float, speed: float) -> None:
        """Take a tick that came at ``at_s`` of wall time."""
        if self._is_steady and speed == self.speed != inf:
            self._due_s += (tick_ns - self._tick_ns) / 1e9 / speed
            self._took_s += at_s - self._at_s
        self._tick_ns, self._at_s, self.speed = tick_ns, at_s, speed
        self._is_steady = not self._is_held

    def operator_did(self, *, is_held: bool) -> None:
        """Somebody holds the clock, lets it go on, or sets its speed."""
        self._is_held, self._is_steady = is_held, False

    def wall_s(self, sim_time_ns: int) -> float:
        """When an instant is, counted from the newest tick; what is past is due."""
        return self._at_s + max(0, sim_time_ns - self._tick_ns) / 1e9 / self.speed

    @property
    def warning(self) -> str:
        """What to say of a run that did not keep up with its speed; "" if it did."""
        if self._due_s >= SLOW * self._took_s or self._took_s - self._due_s < BEHIND_S:
            return ""
        return (
            f"warning: the run went at {self._due_s / self._took_s:.2f} times the speed that was asked for: rates and "
            "delays that the program measured are off by as much; the record is right"
        )
