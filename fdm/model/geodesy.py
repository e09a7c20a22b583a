"""Positions, and north/east offsets on ArduPilot's own scale.

ArduPilot's SITL turns the NED position it is sent into latitude and longitude with one constant, metres per
1e-7 degree, on both axes (``Location::offset``; east shrinks with the cosine of the mean latitude).
Ellipsoidal metres differ from it by up to 0.7 %, so an exchange that wants the autopilot's latitude to be the
model's latitude must use the same constant. The functions are inverse to each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, isfinite, radians

LATLON_SCALE_M_PER_DEG = 0.011131884502145034e7
"""Metres per degree of latitude (ArduPilot's LOCATION_SCALING_FACTOR is this per 1e-7 degree)."""
LONGITUDE_SCALE_MIN = 0.01
"""ArduPilot's floor for cos(latitude), near the poles."""

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class GeodeticPosition:
    """A place on WGS 84.

    Attributes:
        lat_deg: geodetic latitude, -90 to 90.
        lon_deg: longitude, -180 to 180.
        alt_amsl_m: height above mean sea level (taken as the ellipsoid's), m.

    Raises:
        ValueError: a value is out of its range or not finite.
    """

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float

    def __post_init__(self) -> None:
        if not -90.0 <= self.lat_deg <= 90.0:
            raise ValueError(f"lat_deg = {self.lat_deg}: must be from -90 to 90")
        if not -180.0 <= self.lon_deg <= 180.0:
            raise ValueError(f"lon_deg = {self.lon_deg}: must be from -180 to 180")
        if not isfinite(self.alt_amsl_m):
            raise ValueError(f"alt_amsl_m = {self.alt_amsl_m}: must be finite")


@dataclass(frozen=True, slots=True)
class Home:
    """Where a UA stands at its start, and which way it looks.

    Attributes:
        position: place of the ground below it; the origin of its NED frame.
        yaw_deg: heading, clockwise from true north.
    """

    position: GeodeticPosition
    yaw_deg: float = 0.0

    def __post_init__(self) -> None:
        if not isfinite(self.yaw_deg):
            raise ValueError(f"yaw_deg = {self.yaw_deg}: must be finite")


def ned_from_geodetic(origin: GeodeticPosition, position: GeodeticPosition) -> Vector:
    """North, east, down offsets of `position` from `origin`, m, on ArduPilot's scale.

    Source: ArduPilot ``Location::get_distance_NED``.
    """
    east_scale = longitude_scale(0.5 * (origin.lat_deg + position.lat_deg))
    return (
        (position.lat_deg - origin.lat_deg) * LATLON_SCALE_M_PER_DEG,
        wrapped_deg(position.lon_deg - origin.lon_deg) * LATLON_SCALE_M_PER_DEG * east_scale,
        origin.alt_amsl_m - position.alt_amsl_m,
    )


def geodetic_from_ned(origin: GeodeticPosition, ned_m: Vector) -> GeodeticPosition:
    """The place at `ned_m` (m, on ArduPilot's scale) from `origin`.

    Source: ArduPilot ``Location::offset``.

    Raises:
        ValueError: the offset leads over a pole.
    """
    return GeodeticPosition(*_moved(origin, ned_m))


def measured_place(origin: GeodeticPosition, ned_m: Vector) -> GeodeticPosition:
    """As geodetic_from_ned, of a place with a sensor's errors: what they put beyond a pole is at the pole."""
    lat_deg, lon_deg, alt_amsl_m = _moved(origin, ned_m)
    return GeodeticPosition(min(max(lat_deg, -90.0), 90.0), lon_deg, alt_amsl_m)


def _moved(origin: GeodeticPosition, ned_m: Vector) -> tuple[float, float, float]:
    """Latitude, longitude and altitude at `ned_m` from `origin`."""
    lat_deg = origin.lat_deg + ned_m[0] / LATLON_SCALE_M_PER_DEG
    east_scale = longitude_scale(0.5 * (origin.lat_deg + lat_deg))
    lon_deg = wrapped_deg(origin.lon_deg + ned_m[1] / LATLON_SCALE_M_PER_DEG / east_scale)
    return (lat_deg, lon_deg, origin.alt_amsl_m - ned_m[2])


def longitude_scale(lat_deg: float) -> float:
    """Length of a degree of longitude at `lat_deg` over that of a degree of latitude."""
    return max(cos(radians(lat_deg)), LONGITUDE_SCALE_MIN)


def wrapped_deg(angle_deg: float) -> float:
    """The same angle from -180 up to, but not, 180 degrees (angles already there are returned unchanged)."""
    if -180.0 <= angle_deg < 180.0:
        return angle_deg
    return (angle_deg + 180.0) % 360.0 - 180.0
