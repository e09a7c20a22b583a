r"""The sensor frame: what the physics answers, one datagram ``\n{...}\n`` per servo packet.

It looks like JSON, and is, but ArduPilot (``SIM_JSON.cpp``) reads it with strstr and sscanf, so its shape is
fixed:

- a leading and a trailing newline (without the first, SITL loses its first frame);
- no white space after ``:``; ``, `` between the numbers of an array;
- numbers only: ``"no_time_sync":1``, as ``true`` reads as 0;
- never NaN or infinity: SITL takes them, and dies later.

Keys: ``timestamp`` s since the autopilot's boot; ``imu.gyro`` rad/s and ``imu.accel_body`` m/s^2 (specific
force), FRD; ``position`` m and ``velocity`` m/s, NED from home; ``attitude`` rad roll, pitch, yaw;
``airspeed`` m/s, equivalent.
Optional: ``rng_1`` m (range finder, down), ``windvane`` (``direction`` rad from the nose, ``speed`` m/s).
``no_time_sync`` 1: SITL does not pace itself; the exchange is its clock.

An autopilot that is called gets the numbers themselves, rounded as in a datagram: it flies the same.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import isfinite

from fdm.errors import ModelDivergedError

Vector = tuple[float, float, float]

_BASE = (
    b'\n{"timestamp":%.9f,"imu":{"gyro":[%.7f, %.7f, %.7f],"accel_body":[%.6f, %.6f, %.6f]},'
    b'"position":[%.5f, %.5f, %.5f],"attitude":[%.8f, %.8f, %.8f],"velocity":[%.6f, %.6f, %.6f],'
    b'"airspeed":%.5f'
)
_EXTRAS = {
    "rangefinder": b',"rng_1":%.4f',
    "windvane": b',"windvane":{"direction":%.5f,"speed":%.4f}',
}
_TAIL = b',"no_time_sync":1}\n'

BASE_COUNT = 17
"""Numbers in a frame without options: timestamp, gyro, accel, position, attitude, velocity, airspeed."""
PLAUSIBLE_MAX = 1e8
"""A frame whose numbers sum to more than this is no flight: the model has diverged."""

Numbers = tuple[float, ...]
"""Of a frame: BASE_COUNT, then those of the optional sensors, in the order in which they are sent."""
Encoder = Callable[[Numbers], bytes]
Rounder = Callable[[Numbers], Numbers]
_EXTRA_SCALES = {"rangefinder": (1e4,), "windvane": (1e5, 1e4)}
"""Of their last decimals."""
_WHOLE = 1.5 * 2.0**52
"""Added to a double and taken away again, it leaves a whole number, half to even: faster than a call."""


@dataclass(frozen=True, slots=True)
class SensorFrame:
    """One sensor frame as a client sees it; units as in the module's head."""

    timestamp_s: float
    gyro_frd_radps: Vector
    specific_force_frd_mps2: Vector
    position_ned_m: Vector
    attitude_rad: Vector
    velocity_ned_mps: Vector
    airspeed_eas_mps: float
    rangefinder_m: float | None = None
    windvane_direction_rad: float | None = None
    windvane_speed_mps: float | None = None


def make_encoder(extras: Iterable[str] = ()) -> Encoder:
    """An encoder for frames with the optional sensors `extras`.

    Args:
        extras: any of ``rangefinder``, ``windvane``.

    Returns:
        A function from the frame's numbers to its datagram. It raises ModelDivergedError instead of sending a number
        that is not finite or not plausible.

    Raises:
        ValueError: an unknown sensor.
    """
    wanted = tuple(extras)
    layout = _BASE + b"".join(_EXTRAS[name] for name in _known(wanted)) + _TAIL
    rounded = make_rounder(wanted)

    def encode(values: Numbers) -> bytes:
        return layout % rounded(values)

    return encode


def make_rounder(extras: Iterable[str] = ()) -> Rounder:
    """A function that rounds numbers of frames to what their datagrams say; `extras`, errors: see `make_encoder`."""
    scales = [scale for name in _known(tuple(extras)) for scale in _EXTRA_SCALES[name]]

    def rounded(values: Numbers) -> Numbers:
        # One comparison catches NaN and infinity as well: NaN compares false.
        if not -PLAUSIBLE_MAX < sum(values) < PLAUSIBLE_MAX:
            raise ModelDivergedError("the flight model gave " + ", ".join(f"{value:g}" for value in values))
        # The time is a whole number of nanoseconds.
        time_s, p, q, r, x, y, z, north, east, down, roll, pitch, yaw, v_n, v_e, v_d, airspeed = values[
            :BASE_COUNT
        ]
        whole = _WHOLE
        base = (
            time_s,
            (p * 1e7 + whole - whole) / 1e7,
            (q * 1e7 + whole - whole) / 1e7,
            (r * 1e7 + whole - whole) / 1e7,
            (x * 1e6 + whole - whole) / 1e6,
            (y * 1e6 + whole - whole) / 1e6,
            (z * 1e6 + whole - whole) / 1e6,
            (north * 1e5 + whole - whole) / 1e5,
            (east * 1e5 + whole - whole) / 1e5,
            (down * 1e5 + whole - whole) / 1e5,
            (roll * 1e8 + whole - whole) / 1e8,
            (pitch * 1e8 + whole - whole) / 1e8,
            (yaw * 1e8 + whole - whole) / 1e8,
            (v_n * 1e6 + whole - whole) / 1e6,
            (v_e * 1e6 + whole - whole) / 1e6,
            (v_d * 1e6 + whole - whole) / 1e6,
            (airspeed * 1e5 + whole - whole) / 1e5,
        )
        if not scales:
            return base
        return base + tuple(
            (value * scale + whole - whole) / scale
            for value, scale in zip(values[BASE_COUNT:], scales, strict=True)
        )

    return rounded


def _known(extras: tuple[str, ...]) -> list[str]:
    """Optional sensors in the order in which they are sent."""
    for name in extras:
        if name not in _EXTRAS:
            raise ValueError(f"unknown sensor {name!r}: known are {', '.join(_EXTRAS)}")
    return [name for name in _EXTRAS if name in extras]


def decode_sensor_frame(datagram: bytes) -> SensorFrame | None:
    """The frame in `datagram`, or None if it holds no complete and finite one. Never raises."""
    try:
        data = json.loads(datagram)
        vane = data.get("windvane", {})
        frame = SensorFrame(
            float(data["timestamp"]),
            _vector(data["imu"]["gyro"]),
            _vector(data["imu"]["accel_body"]),
            _vector(data["position"]),
            _vector(data["attitude"]),
            _vector(data["velocity"]),
            float(data["airspeed"]),
            _optional(data.get("rng_1")),
            _optional(vane.get("direction")),
            _optional(vane.get("speed")),
        )
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        return None
    return frame if isfinite(frame.timestamp_s) and isfinite(frame.airspeed_eas_mps) else None


def _vector(values: Sequence[float]) -> Vector:
    x, y, z = (float(value) for value in values)
    if not (isfinite(x) and isfinite(y) and isfinite(z)):
        raise ValueError("not finite")
    return (x, y, z)


def _optional(value: object) -> float | None:
    if value is None:
        return None
    number = float(value)  # type: ignore[arg-type]
    if not isfinite(number):
        raise ValueError("not finite")
    return number
