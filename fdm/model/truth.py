"""The true state of one UA."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class TrueState:
    """True state of one UA at one instant, free of any sensor's error.

    Attributes:
        ua_id: which UA.
        sim_time_ns: fleet sim time.
        lat_deg: geodetic latitude.
        lon_deg: longitude.
        alt_amsl_m: height above mean sea level.
        position_ned_m: from that UA's home, on ArduPilot's scale (fdm.model.geodesy).
        velocity_ned_mps: over the ground.
        attitude_wxyz: rotation from body (FRD) to NED, unit quaternion.
        body_rates_frd_radps: turn rate of the body against inertial space, as a gyro measures it.
        specific_force_frd_mps2: as an accelerometer at the centre of gravity measures it; (0, 0, -9.8) at
            rest.
        airspeed_mps: true airspeed.
        wind_ned_mps: velocity of the air that the UA feels.
    """

    ua_id: int
    sim_time_ns: int
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    position_ned_m: Vector
    velocity_ned_mps: Vector
    attitude_wxyz: Quaternion
    body_rates_frd_radps: Vector
    specific_force_frd_mps2: Vector
    airspeed_mps: float
    wind_ned_mps: Vector


def quaternion_from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
    """Unit quaternion (w, x, y, z), body to NED, of the Euler angles in the order yaw, pitch, roll."""
    cr, sr = cos(0.5 * roll_rad), sin(0.5 * roll_rad)
    cp, sp = cos(0.5 * pitch_rad), sin(0.5 * pitch_rad)
    cy, sy = cos(0.5 * yaw_rad), sin(0.5 * yaw_rad)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
