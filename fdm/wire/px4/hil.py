"""The messages of PX4's simulator interface (MAVLink's common.xml): layouts, and records of what they hold.

To PX4: HIL_SENSOR (its time is PX4's clock), HIL_GPS, HIL_STATE_QUATERNION (truth, for PX4's log alone). From PX4:
HIL_ACTUATOR_CONTROLS, one for each HIL_SENSOR of IMU 0 once its modules run; HEARTBEAT and COMMAND_LONG, once, when it
has connected. Fields are in wire order, largest first; https://mavlink.io/en/messages/common.html has their units.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import cache
from math import isfinite
from typing import NamedTuple

from fdm.wire.px4.mavlink import FrameWriter

HEARTBEAT, COMMAND_LONG = 0, 76
HIL_ACTUATOR_CONTROLS, HIL_SENSOR, HIL_GPS, HIL_STATE_QUATERNION = 93, 107, 113, 115
CRC_EXTRA = {
    HEARTBEAT: 50,
    COMMAND_LONG: 152,
    HIL_ACTUATOR_CONTROLS: 47,
    HIL_SENSOR: 108,
    HIL_GPS: 124,
    HIL_STATE_QUATERNION: 4,
}
FROM_PX4 = {HIL_ACTUATOR_CONTROLS: CRC_EXTRA[HIL_ACTUATOR_CONTROLS]}
"""What is read of PX4; the rest is passed over."""

ACCEL, GYRO, MAG, BARO, DIFFERENTIAL = 0x007, 0x038, 0x1C0, 0x1A00, 0x400
"""Bits of `HilSensor.fields_updated`, each for all fields of a sensor."""
ARMED = 0x80
"""Bit of `ActuatorControls.mode`."""
LOCKSTEP = 1
"""Bit of HIL_ACTUATOR_CONTROLS' flags."""
CONTROLS = 16

_SENSOR = struct.Struct("<Q13fIB")
_GPS = struct.Struct("<Q3i3H3hH2BBH")
_STATE = struct.Struct("<Q7f3i3h2H3h")
_ACTUATORS = struct.Struct("<QQ16fB")

Vector = tuple[float, float, float]


class HilSensor(NamedTuple):
    """What the sensors measure; one that `fields_updated` lacks is ignored."""

    time_us: int
    specific_force_frd_mps2: Vector
    body_rates_frd_radps: Vector
    magnetic_field_frd_gauss: Vector
    pressure_hpa: float
    differential_pressure_hpa: float
    pressure_altitude_m: float
    temperature_degc: float
    fields_updated: int


class HilGps(NamedTuple):
    """A fix of the satellite receiver."""

    time_us: int
    """Since 1970: PX4 takes it for the time of day."""
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    eph_m: float
    epv_m: float
    velocity_ned_mps: Vector
    satellites: int = 10
    fix_type: int = 3


class HilState(NamedTuple):
    """The truth."""

    time_us: int
    attitude_wxyz: tuple[float, float, float, float]
    body_rates_frd_radps: Vector
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    velocity_ned_mps: Vector
    indicated_airspeed_mps: float
    true_airspeed_mps: float
    specific_force_frd_mps2: Vector


class ActuatorControls(NamedTuple):
    """What PX4 has its actuators do.

    Attributes:
        time_us: of the HIL_SENSOR that this answers.
        controls: 0 to 1 for motors, -1 to 1 for others; 0 while it is disarmed.
        is_armed: whether it is armed.
        is_lockstep: whether its clock is that of HIL_SENSOR, as it was built.
    """

    time_us: int
    controls: tuple[float, ...]
    is_armed: bool
    is_lockstep: bool = True


def sensor_frame(writer: FrameWriter, sensor: HilSensor) -> bytes:
    """The frame of HIL_SENSOR, of IMU 0."""
    payload = _SENSOR.pack(
        sensor.time_us,
        *sensor.specific_force_frd_mps2,
        *sensor.body_rates_frd_radps,
        *sensor.magnetic_field_frd_gauss,
        sensor.pressure_hpa,
        sensor.differential_pressure_hpa,
        sensor.pressure_altitude_m,
        sensor.temperature_degc,
        sensor.fields_updated,
        0,
    )
    return writer.frame(HIL_SENSOR, CRC_EXTRA[HIL_SENSOR], payload)


def gps_frame(writer: FrameWriter, gps: HilGps) -> bytes:
    """The frame of HIL_GPS, of receiver 0, which does not know its heading."""
    north, east, _ = gps.velocity_ned_mps
    payload = _GPS.pack(
        gps.time_us,
        round(gps.lat_deg * 1e7),
        round(gps.lon_deg * 1e7),
        round(gps.alt_amsl_m * 1e3),
        _scaled(gps.eph_m, 100, 0, 65535),
        _scaled(gps.epv_m, 100, 0, 65535),
        _scaled((north * north + east * east) ** 0.5, 100, 0, 65534),
        *(_scaled(speed, 100, -32768, 32767) for speed in gps.velocity_ned_mps),
        65535,  # course over ground: not known
        gps.fix_type,
        gps.satellites,
        0,
        0,
    )
    return writer.frame(HIL_GPS, CRC_EXTRA[HIL_GPS], payload)


def state_frame(writer: FrameWriter, state: HilState) -> bytes:
    """The frame of HIL_STATE_QUATERNION."""
    payload = _STATE.pack(
        state.time_us,
        *state.attitude_wxyz,
        *state.body_rates_frd_radps,
        round(state.lat_deg * 1e7),
        round(state.lon_deg * 1e7),
        round(state.alt_amsl_m * 1e3),
        *(_scaled(speed, 100, -32768, 32767) for speed in state.velocity_ned_mps),
        _scaled(state.indicated_airspeed_mps, 100, 0, 65535),
        _scaled(state.true_airspeed_mps, 100, 0, 65535),
        *(_scaled(force, 1000 / 9.80665, -32768, 32767) for force in state.specific_force_frd_mps2),
    )
    return writer.frame(HIL_STATE_QUATERNION, CRC_EXTRA[HIL_STATE_QUATERNION], payload)


def actuators_frame(writer: FrameWriter, answer: ActuatorControls) -> bytes:
    """The frame of HIL_ACTUATOR_CONTROLS, as PX4 would send it.

    Raises:
        ValueError: not 16 controls.
    """
    if len(answer.controls) != CONTROLS:
        raise ValueError(f"{len(answer.controls)} controls: there are {CONTROLS}")
    flags, mode = LOCKSTEP * answer.is_lockstep, ARMED * answer.is_armed | 1
    payload = _ACTUATORS.pack(answer.time_us, flags, *answer.controls, mode)
    return writer.frame(HIL_ACTUATOR_CONTROLS, CRC_EXTRA[HIL_ACTUATOR_CONTROLS], payload)


def read_actuators(payload: bytes) -> ActuatorControls | None:
    """What a payload of HIL_ACTUATOR_CONTROLS holds; None: it is too long, or holds a number that is not finite."""
    if len(payload) > _ACTUATORS.size:
        return None
    time_us, flags, *controls, mode = _ACTUATORS.unpack(payload.ljust(_ACTUATORS.size, b"\0"))
    if not isfinite(sum(controls)):
        return None
    return ActuatorControls(time_us, tuple(controls), bool(mode & ARMED), bool(flags & LOCKSTEP))


def pulse_widths(controls: Sequence[float], motors: frozenset[int]) -> tuple[int, ...]:
    """Controls as pulse widths, which airframes are driven by, us: 1000 to 2000, 1500 is the middle of a servo.

    Args:
        controls: of outputs 1, 2, ..., 16 at most.
        motors: outputs that are motors, of which 0 is 1000 us.
    """
    return tuple(
        [
            middle + round(span * (low if control < low else 1.0 if control > 1.0 else control))
            for control, (low, middle, span) in zip(controls, _ranges(motors), strict=False)
        ]
    )


@cache
def _ranges(motors: frozenset[int]) -> tuple[tuple[float, int, int], ...]:
    """Of each output: its least control, the pulse width of 0, and what 1 adds to that, us."""
    return tuple(
        (0.0, 1000, 1000) if output in motors else (-1.0, 1500, 500) for output in range(1, CONTROLS + 1)
    )


def _scaled(value: float, scale: float, low: int, high: int) -> int:
    return min(max(round(value * scale), low), high)
