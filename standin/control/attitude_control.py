"""The inner loops: attitude error -> body rate -> torque, at every sensor frame."""

from __future__ import annotations

from math import pi

from standin.control.quaternion import Quaternion, Vector, rotation_error

TORQUE_MAX = 1.0
INTEGRAL_MAX = 0.25
DERIVATIVE_FILTER_TIME_S = 1.0 / (2.0 * pi * 40.0)


ANGLE_P, YAW_ANGLE_P = 6.0, 3.0
RATE_P, RATE_I, RATE_D = 0.10, 0.10, 0.004
YAW_RATE_P, YAW_RATE_I = 0.25, 0.03
"""Gains; torques are on the mixer's scale."""
RATE_MAX_RADPS, YAW_RATE_MAX_RADPS = 4.0, 1.5


class AttitudeController:
    """Keeps an attitude; state: the rate integrals and the filtered derivative."""

    def __init__(self) -> None:
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
        roll_error, pitch_error, yaw_error = rotation_error(attitude, target)
        rates = (
            _limited(ANGLE_P * roll_error, RATE_MAX_RADPS),
            _limited(ANGLE_P * pitch_error, RATE_MAX_RADPS),
            _limited(YAW_ANGLE_P * yaw_error + yaw_rate_radps, YAW_RATE_MAX_RADPS),
        )
        return self._update_rates(gyro_radps, rates, step_s)

    def _update_rates(self, gyro_radps: Vector, target_radps: Vector, step_s: float) -> Vector:
        p, q, r = gyro_radps
        old_p, old_q, _ = self._gyro_radps
        self._gyro_radps = gyro_radps
        blend = step_s / (step_s + DERIVATIVE_FILTER_TIME_S)
        self._roll_d += blend * ((p - old_p) / step_s - self._roll_d)
        self._pitch_d += blend * ((q - old_q) / step_s - self._pitch_d)
        roll_error, pitch_error, yaw_error = target_radps[0] - p, target_radps[1] - q, target_radps[2] - r
        gain = RATE_I * step_s
        roll_i = self._roll_i = _limited(self._roll_i + gain * roll_error, INTEGRAL_MAX)
        pitch_i = self._pitch_i = _limited(self._pitch_i + gain * pitch_error, INTEGRAL_MAX)
        yaw_i = self._yaw_i = _limited(self._yaw_i + YAW_RATE_I * step_s * yaw_error, INTEGRAL_MAX)
        return (
            _limited(RATE_P * roll_error + roll_i - RATE_D * self._roll_d, TORQUE_MAX),
            _limited(RATE_P * pitch_error + pitch_i - RATE_D * self._pitch_d, TORQUE_MAX),
            _limited(YAW_RATE_P * yaw_error + yaw_i, TORQUE_MAX),
        )


def _limited(value: float, size: float) -> float:
    return size if value > size else -size if value < -size else value
