"""How fast a record is played: which instant of wall time each tick is due at. No clock: wall time is an argument."""

from __future__ import annotations

import math

NS_PER_S = 1e9
RATE_PERIOD_S = 1.0
"""Over which the real-time factor is measured."""


class Pace:
    """Wall time for sim time.

    Args:
        speed: real-time factor; inf: as fast as can be.
        sim_time_ns: where playing begins.
        now_s: wall time, of any clock that does not go back.
        paused: whether to begin so.

    Attributes:
        real_time_factor: as measured; nan before there is anything to measure.
    """

    def __init__(self, speed: float, sim_time_ns: int, now_s: float, *, paused: bool = False) -> None:
        self._speed = speed
        self._paused = paused
        self.real_time_factor = math.nan
        self.move(sim_time_ns, now_s)

    @property
    def speed(self) -> float:
        """Real-time factor asked for."""
        return self._speed

    @property
    def paused(self) -> bool:
        """Whether no tick is due."""
        return self._paused

    def move(self, sim_time_ns: int, now_s: float) -> None:
        """Go on from another instant: what follows is counted from it and from now."""
        self._anchor_ns, self._anchor_s = sim_time_ns, now_s
        self._latest_ns = sim_time_ns
        self._measured_ns, self._measured_s = sim_time_ns, now_s

    def set_speed(self, speed: float, now_s: float) -> None:
        """Go on from here at another speed."""
        self.move(self._latest_ns, now_s)
        self._speed = speed

    def pause(self) -> None:
        """Let no tick be due until `resume`."""
        self._paused = True
        self.real_time_factor = 0.0

    def resume(self, now_s: float) -> None:
        """Go on from where it was paused."""
        self._paused = False
        self.move(self._latest_ns, now_s)

    def due_s(self, sim_time_ns: int) -> float:
        """Wall time at which a tick is due; inf while paused."""
        if self._paused:
            return math.inf
        return self._anchor_s + (sim_time_ns - self._anchor_ns) / NS_PER_S / self._speed

    def played(self, sim_time_ns: int, now_s: float) -> None:
        """Take note that a tick was played. A player that cannot keep up does not hurry later: it goes on from here."""
        self._latest_ns = sim_time_ns
        if now_s - self.due_s(sim_time_ns) > RATE_PERIOD_S:
            self._anchor_ns, self._anchor_s = sim_time_ns, now_s
        if now_s - self._measured_s >= RATE_PERIOD_S and not self._paused:
            passed_s = (sim_time_ns - self._measured_ns) / NS_PER_S
            self.real_time_factor = passed_s / (now_s - self._measured_s)
            self._measured_ns, self._measured_s = sim_time_ns, now_s
