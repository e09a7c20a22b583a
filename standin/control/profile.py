"""Position profiles limited in speed, acceleration and jerk.

The reference chases its target through two nested laws: the speed wanted for the distance left (linear when
near, then the square root that a constant braking gives), and the acceleration wanted for the speed that is
missing, whose change is limited by the jerk. The braking planned takes ``BRAKING_SHARE`` of the acceleration
allowed: what is left absorbs the time that the jerk limit needs, so that the reference does not overshoot.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, sqrt

BRAKING_SHARE = 0.7
POSITION_GAIN_SHARE = 0.3
"""Position gain as a share of the velocity gain (jerk / acceleration); 0.25 is critically damped."""


@dataclass(frozen=True, slots=True)
class Limits:
    """How fast a reference may move."""

    speed_mps: float
    accel_mps2: float
    jerk_mps3: float


def approach_speed_mps(distance_m: float, gain_per_s: float, accel_mps2: float) -> float:
    """Return the speed at which to approach a point that is ``distance_m`` >= 0 away.

    Args:
        distance_m: distance left.
        gain_per_s: slope near the point.
        accel_mps2: braking that the far part plans with.
    """
    linear_m = accel_mps2 / (gain_per_s * gain_per_s)
    if distance_m <= linear_m:
        return gain_per_s * distance_m
    return sqrt(2.0 * accel_mps2 * (distance_m - 0.5 * linear_m))


class HorizontalProfile:
    """The horizontal reference: position, velocity and acceleration, north and east."""

    def __init__(self) -> None:
        self.north_m = self.east_m = 0.0
        self.north_mps = self.east_mps = 0.0
        self.north_mps2 = self.east_mps2 = 0.0

    def reset(self, north_m: float, east_m: float, north_mps: float = 0.0, east_mps: float = 0.0) -> None:
        """Start from a position and velocity, without acceleration."""
        self.north_m, self.east_m = north_m, east_m
        self.north_mps, self.east_mps = north_mps, east_mps
        self.north_mps2 = self.east_mps2 = 0.0

    def step_to_position(
        self,
        target_m: tuple[float, float],
        limits: Limits,
        step_s: float,
        target_mps: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Move on for ``step_s`` towards a point, which itself moves at ``target_mps``."""
        to_north_m, to_east_m = target_m[0] - self.north_m, target_m[1] - self.east_m
        distance_m = hypot(to_north_m, to_east_m)
        wanted = target_mps
        if distance_m > 1e-9:
            gain = POSITION_GAIN_SHARE * limits.jerk_mps3 / limits.accel_mps2
            speed_mps = approach_speed_mps(distance_m, gain, BRAKING_SHARE * limits.accel_mps2)
            share = min(speed_mps, limits.speed_mps) / distance_m
            wanted = (share * to_north_m + target_mps[0], share * to_east_m + target_mps[1])
        self.step_to_velocity(wanted, limits, step_s)

    def step_to_velocity(self, target_mps: tuple[float, float], limits: Limits, step_s: float) -> None:
        """Move on for ``step_s`` towards a velocity (north, east; m/s), which no speed limits."""
        missing_north, missing_east = target_mps[0] - self.north_mps, target_mps[1] - self.east_mps
        missing = hypot(missing_north, missing_east)
        wanted_north = wanted_east = 0.0
        if missing > 1e-9:
            gain = limits.jerk_mps3 / limits.accel_mps2
            share = min(approach_speed_mps(missing, gain, limits.jerk_mps3), limits.accel_mps2) / missing
            wanted_north, wanted_east = share * missing_north, share * missing_east
        change_north, change_east = _shortened(
            wanted_north - self.north_mps2, wanted_east - self.east_mps2, limits.jerk_mps3 * step_s
        )
        self.north_mps2 += change_north
        self.east_mps2 += change_east
        self.north_m += step_s * (self.north_mps + 0.5 * step_s * self.north_mps2)
        self.east_m += step_s * (self.east_mps + 0.5 * step_s * self.east_mps2)
        self.north_mps += step_s * self.north_mps2
        self.east_mps += step_s * self.east_mps2


class VerticalProfile:
    """The vertical reference, down: position, velocity and acceleration."""

    def __init__(self) -> None:
        self.down_m = self.down_mps = self.down_mps2 = 0.0

    def reset(self, down_m: float, down_mps: float = 0.0) -> None:
        """Start from a position and velocity, without acceleration."""
        self.down_m, self.down_mps, self.down_mps2 = down_m, down_mps, 0.0

    def step_to_position(
        self,
        target_m: float,
        up_mps: float,
        down_mps: float,
        limits: Limits,
        step_s: float,
        target_mps: float = 0.0,
    ) -> None:
        """Move on for ``step_s`` towards a depth, which itself moves at ``target_mps``.

        Climb and sink to it at most at the speeds given (>= 0).
        """
        distance_m = target_m - self.down_m
        gain = POSITION_GAIN_SHARE * limits.jerk_mps3 / limits.accel_mps2
        speed_mps = approach_speed_mps(abs(distance_m), gain, BRAKING_SHARE * limits.accel_mps2)
        wanted_mps = min(speed_mps, down_mps) if distance_m > 0.0 else -min(speed_mps, up_mps)
        self.step_to_velocity(target_mps + wanted_mps, limits, step_s)

    def step_to_velocity(self, target_mps: float, limits: Limits, step_s: float) -> None:
        """Move on for ``step_s`` towards a velocity down."""
        missing = target_mps - self.down_mps
        gain = limits.jerk_mps3 / limits.accel_mps2
        size = min(approach_speed_mps(abs(missing), gain, limits.jerk_mps3), limits.accel_mps2)
        wanted = size if missing > 0.0 else -size
        most = limits.jerk_mps3 * step_s
        self.down_mps2 += max(-most, min(most, wanted - self.down_mps2))
        self.down_m += step_s * (self.down_mps + 0.5 * step_s * self.down_mps2)
        self.down_mps += step_s * self.down_mps2


def _shortened(x: float, y: float, length: float) -> tuple[float, float]:
    size = hypot(x, y)
    if size <= length:
        return x, y
    return x * length / size, y * length / size
