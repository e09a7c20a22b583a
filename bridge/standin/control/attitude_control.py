"""The inner loops: attitude error -> body rate -> torque, at every sensor frame.

Gains carry ArduPilot's names and defaults where they fit (``ATC_ANG_*_P``, ``ATC_RAT_*``).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

from bridge.standin.control.quaternion import Quaternion, Vector, rotation_error

TORQUE_MAX = 1.0
INTEGRAL_MAX = 0.25
DERIVATIVE_FILTER_TIME_S = 1.0 / (2.0 * pi * 40.0)


@dataclass(frozen=True, slots=True)
class AttitudeGains:
    """Gains of the attitude and rate loops; torques are on the mixer's scale."""

    angle_p: float = 6.0
    yaw_angle_p: float = 3.0
    rate_p: float = 0.10
    rate_i: float = 0.10
    rate_d: float = 0.004
    yaw_rate_p: float = 0.25
    yaw_rate_i: float = 0.03
    rate_max_radps: float = 4.0
    yaw_rate_max_radps: float = 1.5


class AttitudeController:
    """Keeps an attitude; state: the rate integrals and the filtered derivative."""

    def __init__(self, gains: AttitudeGains) -> None:
        self.gains = gains
        self.reset((0.0, 0.0, 0.0))

    def reset(self, gyro_radps: Vector) -> None:
        """Forget the integrals."""
        self._roll_i = self._pitch_i = self._yaw_i = 0.0
        self._roll_d = self._pitch_d = 0.0
        self._gyro_radps = gyro_radps

    def update(
        self,
        attitude: Quaternion,
        gyro_radps: Vector,
        target: Quaternion,
        yaw_rate_radps: float,
        step_s: float,
    ) -> Vector:
        """Return the torque commands (roll, pitch, yaw), -1..1 each.

        Args:
            attitude: the present attitude.
            gyro_radps: the present body rates.
            target: the attitude wanted.
            yaw_rate_radps: rate at which the target's yaw turns.
            step_s: time since the last update, > 0.
        """
        gains = self.gains
        roll_error, pitch_error, yaw_error = rotation_error(attitude, target)
        rates = (
            _limited(gains.angle_p * roll_error, gains.rate_max_radps),
            _limited(gains.angle_p * pitch_error, gains.rate_max_radps),
            _limited(gains.yaw_angle_p * yaw_error + yaw_rate_radps, gains.yaw_rate_max_radps),
        )
        return self.update_rates(gyro_radps, rates, step_s)

    def update_rates(self, gyro_radps: Vector, target_radps: Vector, step_s: float) -> Vector:
        """Return the torque commands for body rates wanted."""
        gains = self.gains
        p, q, r = gyro_radps
        old_p, old_q, _ = self._gyro_radps
        self._gyro_radps = gyro_radps
        blend = step_s / (step_s + DERIVATIVE_FILTER_TIME_S)
        self._roll_d += blend * ((p - old_p) / step_s - self._roll_d)
        self._pitch_d += blend * ((q - old_q) / step_s - self._pitch_d)
        roll_error, pitch_error, yaw_error = target_radps[0] - p, target_radps[1] - q, target_radps[2] - r
        gain = gains.rate_i * step_s
        roll_i = self._roll_i = _limited(self._roll_i + gain * roll_error, INTEGRAL_MAX)
        pitch_i = self._pitch_i = _limited(self._pitch_i + gain * pitch_error, INTEGRAL_MAX)
        yaw_i = self._yaw_i = _limited(self._yaw_i + gains.yaw_rate_i * step_s * yaw_error, INTEGRAL_MAX)
        return (
            _limited(gains.rate_p * roll_error + roll_i - gains.rate_d * self._roll_d, TORQUE_MAX),
            _limited(gains.rate_p * pitch_error + pitch_i - gains.rate_d * self._pitch_d, TORQUE_MAX),
            _limited(gains.yaw_rate_p * yaw_error + yaw_i, TORQUE_MAX),
        )


def _limited(value: float, size: float) -> float:
    return size if value > size else -size if value < -size else value
