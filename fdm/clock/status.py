"""What the fleet clock is asked to do, and what it reports at a tick."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite

SPEED_RANGE = (1e-3, 1e6)
"""Sim time per wall time, beside inf."""
RATE_WINDOW_NS = 1_000_000_000
"""Wall time over which the real-time factor is measured."""


@dataclass(frozen=True, slots=True)
class ClockSettings:
    """How a fleet clock runs.

    Attributes:
        speed: sim time per wall time; inf = as fast as possible.
        window_ns: how far a UA may be ahead of the slowest; None = one frame at the slowest rate.
        tick_period_ns: sim time between ticks.
        hold_ticks: a tick must be released before a UA steps beyond it.
        stall_timeout_ns: wall time without a packet after which a UA is let go.
        start_together: nobody steps before every UA has joined.
        start_timeout_ns: wall time after `FleetClock.begin` at which the fleet starts with those that have joined.
    """

    speed: float = 1.0
    window_ns: int | None = None
    tick_period_ns: int = 50_000_000
    hold_ticks: bool = False
    stall_timeout_ns: int = 1_000_000_000
    start_together: bool = True
    start_timeout_ns: int = 60_000_000_000

    def __post_init__(self) -> None:
        check_speed(self.speed)
        for name in ("window_ns", "tick_period_ns", "stall_timeout_ns", "start_timeout_ns"):
            value = getattr(self, name)
            if value is not None and value <= 0:
                raise ValueError(f"{name} = {value}: must be above 0")


@dataclass(frozen=True, slots=True)
class ClockStatus:
    """State of the fleet clock at a tick.

    Attributes:
        sim_time_ns: fleet sim time of the tick.
        speed: wanted sim time per wall time; inf = as fast as possible.
        real_time_factor: sim time per wall time, measured over the last second or so of wall time.
        paused: the clock is held by `pause`.
        stalled_ua: UA that nobody waits for, sorted: those that stopped answering, and those that never
            joined.
        restarts: per UA, how often its autopilot booted anew.
        ended_ua: UA whose flight model diverged, sorted.
    """

    sim_time_ns: int
    speed: float
    real_time_factor: float
    paused: bool
    stalled_ua: tuple[int, ...]
    restarts: Mapping[int, int]
    ended_ua: tuple[int, ...] = ()


class RateMeter:
    """Sim time per wall time, over the last second or so of wall time.

    Args:
        wall_ns: the instant at which sim time is 0.
    """

    def __init__(self, wall_ns: int) -> None:
        self._wall_ns, self._sim_ns, self._rate = wall_ns, 0, 0.0

    def measure(self, sim_time_ns: int, wall_ns: int) -> float:
        """The rate, now that sim time is `sim_time_ns` at the instant `wall_ns`."""
        elapsed_ns = wall_ns - self._wall_ns
        if elapsed_ns >= RATE_WINDOW_NS or (self._rate == 0.0 and elapsed_ns > 0):
            self._rate = (sim_time_ns - self._sim_ns) / elapsed_ns
        if elapsed_ns >= RATE_WINDOW_NS:
            self._wall_ns, self._sim_ns = wall_ns, sim_time_ns
        return self._rate


def check_speed(speed: float) -> None:
    """Refuse a speed that is out of SPEED_RANGE, and not infinite.

    Raises:
        ValueError: so.
    """
    if not (SPEED_RANGE[0] <= speed <= SPEED_RANGE[1] or speed == inf):
        raise ValueError(
            f"speed = {speed}: must be from {SPEED_RANGE[0]:g} to {SPEED_RANGE[1]:g}, or inf (as fast as possible)"
        )


def nanoseconds(name: str, seconds: float) -> int:
    """The time-out `name` in ns.

    Raises:
        ValueError: it is not finite.
    """
    if not isfinite(seconds):
        raise ValueError(f"{name} = {seconds}: must be finite")
    return int(seconds * 1e9)
