"""The outer loops: position and velocity errors -> acceleration -> thrust direction and throttle."""

from __future__ import annotations

from math import hypot, sqrt

from standin.control.profile import HorizontalProfile, VerticalProfile
from standin.control.quaternion import Vector

GRAVITY_MPS2 = 9.80665
THROTTLE_MAX = 0.95
ACCEL_UP_MAX_MPS2 = 6.0
ACCEL_DOWN_MAX_MPS2 = 6.0


POSITION_P, VELOCITY_P, VELOCITY_I = 1.0, 2.4, 0.8
HEIGHT_P, CLIMB_P, CLIMB_I = 1.5, 4.0, 1.5
"""Gains of the position (1/s) and velocity (1/s, 1/s^2) loops."""
CORRECTION_MAX_MPS = 3.0
INTEGRAL_MAX_MPS2 = 6.0


class PositionController:
    """Follows the profiles; its integrals carry the wind and errors of the hover throttle."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the integrals."""
        self._north_i = self._east_i = self._down_i = 0.0
        self.saturated = False
        """Whether the last thrust wanted was beyond the tilt or thrust limit."""

    def forget_horizontal(self) -> None:
        """Forget the horizontal integrals."""
        self._north_i = self._east_i = 0.0

    def thrust(
        self,
        position: Vector,
        velocity: Vector,
        horizontal: HorizontalProfile,
        vertical: VerticalProfile,
        tilt_max_tan: float,
        step_s: float,
    ) -> Vector:
        """Return the specific thrust wanted, NED m/s^2: upwards, its tilt within the limit.

        Args:
            position: NED m.
            velocity: NED m/s.
            horizontal: the reference north and east.
            vertical: the reference down.
            tilt_max_tan: tangent of the largest tilt.
            step_s: time since the last call.
        """
        down_mps2 = self._vertical(position[2], velocity[2], vertical, step_s)
        lift_mps2 = GRAVITY_MPS2 - down_mps2
        north_mps2, east_mps2 = self._horizontal(position, velocity, horizontal, step_s)
        largest = tilt_max_tan * lift_mps2
        size = hypot(north_mps2, east_mps2)
        self.saturated = size > largest
        if self.saturated:
            north_mps2 *= largest / size
            east_mps2 *= largest / size
        return (north_mps2, east_mps2, -lift_mps2)

    def _horizontal(
        self, position: Vector, velocity: Vector, reference: HorizontalProfile, step_s: float
    ) -> tuple[float, float]:
        fix_north = POSITION_P * (reference.north_m - position[0])
        fix_east = POSITION_P * (reference.east_m - position[1])
        size = hypot(fix_north, fix_east)
        if size > CORRECTION_MAX_MPS:
            fix_north *= CORRECTION_MAX_MPS / size
            fix_east *= CORRECTION_MAX_MPS / size
        error_north = reference.north_mps + fix_north - velocity[0]
        error_east = reference.east_mps + fix_east - velocity[1]
        if not self.saturated or error_north * self._north_i + error_east * self._east_i < 0.0:
            self._north_i += VELOCITY_I * step_s * error_north
            self._east_i += VELOCITY_I * step_s * error_east
            size = hypot(self._north_i, self._east_i)
            if size > INTEGRAL_MAX_MPS2:
                self._north_i *= INTEGRAL_MAX_MPS2 / size
                self._east_i *= INTEGRAL_MAX_MPS2 / size
        return (
            reference.north_mps2 + VELOCITY_P * error_north + self._north_i,
            reference.east_mps2 + VELOCITY_P * error_east + self._east_i,
        )

    def _vertical(self, down_m: float, down_mps: float, reference: VerticalProfile, step_s: float) -> float:
        limit = CORRECTION_MAX_MPS
        fix = max(-limit, min(limit, HEIGHT_P * (reference.down_m - down_m)))
        error = reference.down_mps + fix - down_mps
        limit = INTEGRAL_MAX_MPS2
        self._down_i = max(-limit, min(limit, self._down_i + CLIMB_I * step_s * error))
        wanted = reference.down_mps2 + CLIMB_P * error + self._down_i
        return max(-ACCEL_UP_MAX_MPS2, min(ACCEL_DOWN_MAX_MPS2, wanted))


def throttle_for(thrust_mps2: Vector, tilt_cos: float, hover_throttle: float) -> float:
    """Return the mean motor command for a specific thrust (NED) at the present tilt.

    The part of the thrust that the vehicle's own tilt takes from the lift is made good, up to 60 degrees.
    """
    lift_mps2 = -thrust_mps2[2]
    along_mps2 = min(
        lift_mps2 / max(tilt_cos, 0.5), 2.0 * sqrt(lift_mps2 * lift_mps2 + GRAVITY_MPS2 * GRAVITY_MPS2)
    )
    return max(0.0, min(THROTTLE_MAX, hover_throttle * along_mps2 / GRAVITY_MPS2))
