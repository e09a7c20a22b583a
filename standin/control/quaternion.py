"""Attitude algebra on plain floats: quaternions are (w, x, y, z), body (FRD) to NED, of unit length."""

from __future__ import annotations

from math import asin, atan2, cos, pi, sin

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

IDENTITY: Quaternion = (1.0, 0.0, 0.0, 0.0)


def quaternion_from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
    """Return the quaternion of the rotation yaw, then pitch, then roll (rad)."""
    cr, sr = cos(0.5 * roll_rad), sin(0.5 * roll_rad)
    cp, sp = cos(0.5 * pitch_rad), sin(0.5 * pitch_rad)
    cy, sy = cos(0.5 * yaw_rad), sin(0.5 * yaw_rad)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def euler_from_quaternion(q: Quaternion) -> Vector:
    """Return (roll, pitch, yaw) in rad; pitch in [-pi/2, pi/2], the others in (-pi, pi]."""
    w, x, y, z = q
    sin_pitch = 2.0 * (w * y - x * z)
    return (
        atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        asin(max(-1.0, min(1.0, sin_pitch))),
        atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )


def yaw_of(q: Quaternion) -> float:
    """Return the yaw in rad, in (-pi, pi]."""
    w, x, y, z = q
    return atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def thrust_axis_down(q: Quaternion) -> float:
    """Return the cosine of the tilt: 1 level, 0 on the side, -1 upside down."""
    return 1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2])


def rotation_error(attitude: Quaternion, target: Quaternion) -> Vector:
    """Return the rotation vector in body axes (rad, small angles) from ``attitude`` to ``target``."""
    w, x, y, z = attitude
    tw, tx, ty, tz = target
    scalar = w * tw + x * tx + y * ty + z * tz
    two = 2.0 if scalar >= 0.0 else -2.0  # the short way round
    return (
        two * (w * tx - x * tw - y * tz + z * ty),
        two * (w * ty + x * tz - y * tw - z * tx),
        two * (w * tz - x * ty + y * tx - z * tw),
    )


def attitude_for_thrust(thrust_direction_ned: Vector, yaw_rad: float) -> Quaternion:
    """Return the attitude whose body -z axis points along a direction, at a yaw.

    Args:
        thrust_direction_ned: unit vector; its down component must be negative (upwards).
        yaw_rad: yaw of the result.
    """
    # Tilt from level in the heading's frame: body z = -direction.
    cy, sy = cos(yaw_rad), sin(yaw_rad)
    forward = cy * thrust_direction_ned[0] + sy * thrust_direction_ned[1]
    right = -sy * thrust_direction_ned[0] + cy * thrust_direction_ned[1]
    up = -thrust_direction_ned[2]
    pitch_rad = atan2(-forward, up)
    roll_rad = asin(max(-1.0, min(1.0, right)))
    return quaternion_from_euler(roll_rad, pitch_rad, yaw_rad)


def wrapped(angle_rad: float) -> float:
    """Return the angle in [-pi, pi)."""
    return (angle_rad + pi) % (2.0 * pi) - pi
