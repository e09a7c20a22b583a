"""The sensor frame that the physics sends: one JSON object per UDP datagram.

The scheme is that of ArduPilot's SITL JSON backend: ``timestamp`` s, ``imu.gyro`` rad/s, ``imu.accel_body``
m/s^2 (specific force), ``position`` m and ``velocity`` m/s (NED from home), ``attitude`` rad or
``quaternion`` wxyz (body to NED, wins if both are there), ``airspeed`` m/s if the physics knows it.
Physics in this process passes these numbers as they are: time, rates, force, position, attitude (rad), velocity,
airspeed, and those of further sensors, of which nothing is read.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from pydantic_core import from_json

from standin.control.quaternion import Quaternion, Vector, quaternion_from_euler

TIMESTAMP_MAX_S = 1e9
"""Thirty years: a larger time is garbage, and its nanoseconds would not fit 64 bits."""
QUATERNION_NORM_SQUARED_MIN, QUATERNION_NORM_SQUARED_MAX = 0.5, 2.0
POSITION_MAX_M = 1e6
SPEED_MAX_MPS = 1e4
RATE_MAX_RADPS = 1e3
FORCE_MAX_MPS2 = 1e5
ANGLE_MAX_RAD = 100.0


class SensedFrame(NamedTuple):
    """One instant of the physics, as sent (a tuple: one is built for every frame, and it is the cheapest)."""

    timestamp_s: float
    gyro_radps: Vector
    """Body rates, FRD."""
    specific_force_mps2: Vector
    """What an accelerometer reads, FRD; (0, 0, -9.81) at rest and level."""
    position_ned_m: Vector
    velocity_ned_mps: Vector
    attitude_wxyz: Quaternion
    """Body to NED, of unit length."""
    airspeed_mps: float | None


AT_REST = SensedFrame(
    0.0, (0.0, 0.0, 0.0), (0.0, 0.0, -9.80665), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), None
)
"""What is taken for the truth before the first frame."""


def parse_sensor_frame(datagram: bytes) -> SensedFrame | None:
    """Parse one datagram.

    Args:
        datagram: the bytes received.

    Returns:
        The frame, or None if the datagram is not a complete and plausible frame (never raises on bad input).
    """
    try:
        # A third of the time that the standard library takes.
        return _frame_from(from_json(datagram, allow_inf_nan=False, cache_strings="keys"))
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, OverflowError, RecursionError):
        return None


def sensed_frame(numbers: Sequence[float]) -> SensedFrame | None:
    """Return the frame of numbers that are passed, or None if they are not plausible."""
    if not 0.0 <= numbers[0] <= TIMESTAMP_MAX_S or not -SPEED_MAX_MPS <= numbers[16] <= SPEED_MAX_MPS:
        return None
    try:
        return SensedFrame(
            numbers[0],
            _bounded(numbers[1:4], RATE_MAX_RADPS),
            _bounded(numbers[4:7], FORCE_MAX_MPS2),
            _bounded(numbers[7:10], POSITION_MAX_M),
            _bounded(numbers[13:16], SPEED_MAX_MPS),
            quaternion_from_euler(*_bounded(numbers[10:13], ANGLE_MAX_RAD)),
            numbers[16],
        )
    except ValueError:
        return None


def _frame_from(data: Any) -> SensedFrame | None:
    imu = data["imu"]
    timestamp_s = float(data["timestamp"])
    if not 0.0 <= timestamp_s <= TIMESTAMP_MAX_S:
        return None
    airspeed = data.get("airspeed")
    if airspeed is not None and not -SPEED_MAX_MPS <= airspeed <= SPEED_MAX_MPS:
        return None
    return SensedFrame(
        timestamp_s,
        _bounded(imu["gyro"], RATE_MAX_RADPS),
        _bounded(imu["accel_body"], FORCE_MAX_MPS2),
        _bounded(data["position"], POSITION_MAX_M),
        _bounded(data["velocity"], SPEED_MAX_MPS),
        _attitude(data),
        airspeed,
    )


def _bounded(values: Any, limit: float) -> Vector:
    x, y, z = values
    # A NaN compares false, so that it fails here too.
    if -limit <= x <= limit and -limit <= y <= limit and -limit <= z <= limit:
        return (x, y, z)
    raise ValueError


def _attitude(data: Any) -> Quaternion:
    if "quaternion" not in data:
        return quaternion_from_euler(*_bounded(data["attitude"], ANGLE_MAX_RAD))
    w, x, y, z = data["quaternion"]
    norm_squared = w * w + x * x + y * y + z * z
    if not QUATERNION_NORM_SQUARED_MIN <= norm_squared <= QUATERNION_NORM_SQUARED_MAX:
        raise ValueError
    scale = norm_squared**-0.5
    return (w * scale, x * scale, y * scale, z * scale)
