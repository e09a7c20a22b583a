"""The sensors of a UA that PX4 flies: what it is sent in a frame, with their errors.

ArduPilot's SITL makes its sensors of the state that it is sent. PX4 is sent what sensors measure, and refuses to arm on
sensors without noise. Draws are keyed by seed and UA; each boot of the autopilot meets the same errors anew.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import cos, sin, sqrt
from typing import Annotated, Protocol

from pydantic import Field, model_validator

from fdm.errors import ModelDivergedError
from fdm.model.air_point import StaticAir
from fdm.model.geodesy import Home, measured_place
from fdm.model.magnetic_field import magnetic_field_ned_gauss
from fdm.model.truth import TrueState, Vector
from fdm.wire.px4 import hil
from fdm.wire.px4.mavlink import FrameWriter
from fdm.wire.sensor_frame import PLAUSIBLE_MAX
from sitl_configs.settings import Settings, refused

SEA_LEVEL_DENSITY_KG_PER_M3 = 1.225
"""Of the International Standard Atmosphere, to which equivalent airspeed refers."""
GAS_CONSTANT_J_PER_KG_K = 287.05287
"""Of dry air (ISO 2533)."""
SEA_LEVEL_PRESSURE_PA, SEA_LEVEL_TEMPERATURE_K, LAPSE_K_PER_M, EXPONENT = 101325.0, 288.15, 0.0065, 5.2558797
ZERO_CELSIUS_K = 273.15
EPOCH_UNIX_S = 1_700_000_000
"""The time of day at sim time 0 unless said otherwise: no flight depends on the host's."""
SIMULATOR_SYSTEM, SIMULATOR_COMPONENT = 0, 200
GYRO, ACCEL, POSITION = slice(1, 4), slice(4, 7), slice(7, 10)
ATTITUDE, VELOCITY, AIRSPEED = slice(10, 13), slice(13, 16), 16
"""Where a frame's numbers have them (fdm.wire.sensor_frame)."""
GYRO_DRAWS, ACCEL_DRAWS, MAGNETOMETER_DRAWS = slice(0, 3), slice(3, 6), slice(6, 9)
PRESSURE_DRAW, AIRSPEED_DRAW = 9, 10
GPS_POSITION_DRAWS, GPS_VELOCITY_DRAWS = slice(11, 14), slice(14, 17)
"""Where a frame's draws have those for a sensor's errors."""
_BLOCK = 1024
_DRAWS = 18
_STREAM = 0x9754

Sigma = Annotated[float, Field(ge=0)]
Rate = Annotated[int, Field(strict=True, ge=1, le=1000)]


class Px4Sensors(Settings):
    """Rates and errors of the sensors of a UA that PX4 flies.

    Attributes:
        imu_rate_hz: of accelerometer and gyro: frames per second.
        gps_rate_hz, magnetometer_rate_hz, pressure_rate_hz, truth_rate_hz: of the satellite receiver, the magnetometer,
            barometer and airspeed sensor, and of the truth, which PX4 only logs; each divides that of the IMU.
        accel_sigma_mps2, gyro_sigma_radps, magnetometer_sigma_gauss, pressure_sigma_pa, airspeed_pressure_sigma_pa:
            standard deviation per sample and axis.
        gps_horizontal_sigma_m, gps_vertical_sigma_m, gps_velocity_sigma_mps: standard deviation per fix and axis.
    """

    imu_rate_hz: Rate = 250
    gps_rate_hz: Rate = 10
    magnetometer_rate_hz: Rate = 50
    pressure_rate_hz: Rate = 50
    truth_rate_hz: Rate = 50
    accel_sigma_mps2: Sigma = 0.02
    gyro_sigma_radps: Sigma = 0.0005
    magnetometer_sigma_gauss: Sigma = 0.0005
    pressure_sigma_pa: Sigma = 1.0
    airspeed_pressure_sigma_pa: Sigma = 1.0
    gps_horizontal_sigma_m: Sigma = 0.1
    gps_vertical_sigma_m: Sigma = 0.2
    gps_velocity_sigma_mps: Sigma = 0.05

    @model_validator(mode="after")
    def _rates_divide(self) -> Px4Sensors:
        for name in ("gps_rate_hz", "magnetometer_rate_hz", "pressure_rate_hz", "truth_rate_hz"):
            if self.imu_rate_hz % getattr(self, name):
                raise refused(
                    f"has to divide imu_rate_hz, {self.imu_rate_hz} (got {getattr(self, name)})", name
                )
        return self


class InAir(Protocol):
    """What is asked of a flight model."""

    def air(self) -> StaticAir:
        """The air where it is."""

    def truth(self, ua_id: int, sim_time_ns: int) -> TrueState:
        """Its true state."""


class Px4Encoder:
    """Makes the messages of a frame from its numbers (in the order of fdm.wire.sensor_frame).

    Args:
        sensors: rates and errors.
        home: where the UA started; the magnetic field is that of there.
        seed, ua_id: key of the draws.
        has_airspeed: whether it has an airspeed sensor.
        epoch_unix_s: time of day at the autopilot's boot.

    Attributes:
        model: the flight model, whose air and truth are asked for.
    """

    def __init__(
        self,
        sensors: Px4Sensors,
        home: Home,
        *,
        seed: int,
        ua_id: int,
        has_airspeed: bool,
        epoch_unix_s: int = EPOCH_UNIX_S,
    ) -> None:
        self._sensors, self._home, self._key = sensors, home, (seed, ua_id)
        self._has_airspeed = has_airspeed
        self._epoch_us = epoch_unix_s * 1_000_000
        self._field_ned = magnetic_field_ned_gauss(home.position, epoch_unix_s)
        self.model: InAir
        self.reset()

    def reset(self) -> None:
        """The autopilot boots: its sensors begin anew."""
        self._frame = 0
        self._writer = FrameWriter(SIMULATOR_SYSTEM, SIMULATOR_COMPONENT)
        self._errors = _draws(*self._key)
        self._air = StaticAir(SEA_LEVEL_PRESSURE_PA, SEA_LEVEL_TEMPERATURE_K)

    def __call__(self, values: tuple[float, ...]) -> bytes:
        """The messages of the next frame; the IMU's is the last, as PX4 answers it.

        Raises:
            ModelDivergedError: a number is not finite or not plausible.
        """
        if not -PLAUSIBLE_MAX < sum(values) < PLAUSIBLE_MAX:
            raise ModelDivergedError("the flight model gave " + ", ".join(f"{value:g}" for value in values))
        time_us = round(values[0] * 1e6)
        errors = next(self._errors)
        parts = []
        if self._is_due(self._sensors.gps_rate_hz):
            parts.append(hil.gps_frame(self._writer, self._gps(time_us, values, errors)))
        if self._is_due(self._sensors.truth_rate_hz):
            parts.append(hil.state_frame(self._writer, self._truth(time_us)))
        parts.append(hil.sensor_frame(self._writer, self._measured(time_us, values, errors)))
        self._frame += 1
        return b"".join(parts)

    def _is_due(self, rate_hz: int) -> bool:
        return self._frame % (self._sensors.imu_rate_hz // rate_hz) == 0

    def _measured(self, time_us: int, values: tuple[float, ...], errors: list[float]) -> hil.HilSensor:
        s, updated = self._sensors, hil.ACCEL | hil.GYRO
        magnetic: Vector = (0.0, 0.0, 0.0)
        if self._is_due(s.magnetometer_rate_hz):
            updated |= hil.MAG
            field = to_body(self._field_ned, *values[ATTITUDE])
            magnetic = _add(field, errors[MAGNETOMETER_DRAWS], s.magnetometer_sigma_gauss)
        pressure_pa = differential_pa = 0.0
        if self._is_due(s.pressure_rate_hz):
            updated |= hil.BARO | (hil.DIFFERENTIAL if self._has_airspeed else 0)
            self._air = self.model.air()
            pressure_pa = self._air.pressure_pa + errors[PRESSURE_DRAW] * s.pressure_sigma_pa
            differential_pa = 0.5 * SEA_LEVEL_DENSITY_KG_PER_M3 * values[AIRSPEED] ** 2
            differential_pa += errors[AIRSPEED_DRAW] * s.airspeed_pressure_sigma_pa
        return hil.HilSensor(
            time_us,
            _add(values[ACCEL], errors[ACCEL_DRAWS], s.accel_sigma_mps2),
            _add(values[GYRO], errors[GYRO_DRAWS], s.gyro_sigma_radps),
            magnetic,
            pressure_pa / 100.0,
            differential_pa / 100.0,
            pressure_altitude_m(pressure_pa) if pressure_pa > 0.0 else 0.0,
            self._air.temperature_k - ZERO_CELSIUS_K,
            updated,
        )

    def _gps(self, time_us: int, values: tuple[float, ...], errors: list[float]) -> hil.HilGps:
        s = self._sensors
        sigmas = (s.gps_horizontal_sigma_m, s.gps_horizontal_sigma_m, s.gps_vertical_sigma_m)
        drawn = zip(values[POSITION], errors[GPS_POSITION_DRAWS], sigmas, strict=True)
        north, east, down = (value + draw * sigma for value, draw, sigma in drawn)
        place = measured_place(self._home.position, (north, east, down))
        velocity = _add(values[VELOCITY], errors[GPS_VELOCITY_DRAWS], s.gps_velocity_sigma_mps)
        return hil.HilGps(
            self._epoch_us + time_us, place.lat_deg, place.lon_deg, place.alt_amsl_m, 0.9, 1.5, velocity
        )

    def _truth(self, time_us: int) -> hil.HilState:
        """What PX4 logs as the truth: the model's, without the errors of sensors (also fdm.model.sensor_noise)."""
        true, air = self.model.truth(self._key[1], time_us * 1000), self.model.air()
        density = air.pressure_pa / (GAS_CONSTANT_J_PER_KG_K * air.temperature_k)
        return hil.HilState(
            time_us,
            true.attitude_wxyz,
            true.body_rates_frd_radps,
            true.lat_deg,
            true.lon_deg,
            true.alt_amsl_m,
            true.velocity_ned_mps,
            true.airspeed_mps * sqrt(density / SEA_LEVEL_DENSITY_KG_PER_M3),
            true.airspeed_mps,
            true.specific_force_frd_mps2,
        )


def to_body(ned: Vector, roll_rad: float, pitch_rad: float, yaw_rad: float) -> Vector:
    """A vector in local axes, in the body's (FRD); Euler angles in the order yaw, pitch, roll."""
    cr, sr, cp, sp = cos(roll_rad), sin(roll_rad), cos(pitch_rad), sin(pitch_rad)
    cy, sy = cos(yaw_rad), sin(yaw_rad)
    north, east, down = ned
    ahead, across = cy * north + sy * east, cy * east - sy * north
    below = sp * ahead + cp * down
    return (cp * ahead - sp * down, cr * across + sr * below, cr * below - sr * across)


def pressure_altitude_m(pressure_pa: float) -> float:
    """Height of a pressure in the troposphere of the International Standard Atmosphere (ISO 2533), m."""
    ratio: float = (pressure_pa / SEA_LEVEL_PRESSURE_PA) ** (1.0 / EXPONENT)
    return SEA_LEVEL_TEMPERATURE_K / LAPSE_K_PER_M * (1.0 - ratio)


def _add(values: tuple[float, ...], errors: list[float], sigma: float) -> Vector:
    return (
        values[0] + errors[0] * sigma,
        values[1] + errors[1] * sigma,
        values[2] + errors[2] * sigma,
    )


def _draws(seed: int, ua_id: int) -> Iterator[list[float]]:
    """Standard normal draws, one row per frame."""
    import numpy as np  # late: whoever only reads a scenario does without

    generator = np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, ua_id, _STREAM])))
    while True:
        yield from generator.standard_normal((_BLOCK, _DRAWS)).tolist()
