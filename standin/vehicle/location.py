"""Positions on the earth and metres from an origin, with ArduPilot's own constants.

ArduPilot takes 0.011131884502145034 m per 1e-7 degree of latitude (a sphere of the equatorial radius) and
the cosine of the mean latitude for longitude (``Location::get_distance_NE``); ellipsoidal metres differ by
up to 0.7 %.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians

METRES_PER_DEGREE = 0.011131884502145034 * 1e7
LONGITUDE_SCALE_MIN = 0.01
ALT_MAX_M = 83_000.0
"""ArduPilot takes no height from here on (LOCATION_ALT_MAX_M)."""


@dataclass(frozen=True, slots=True)
class Location:
    """A point: degrees WGS-84 and metres above mean sea level."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float

    @property
    def lat_e7(self) -> int:
        """Latitude in 1e-7 degrees."""
        return round(self.lat_deg * 1e7)

    @property
    def lon_e7(self) -> int:
        """Longitude in 1e-7 degrees."""
        return round(self.lon_deg * 1e7)

    def offset(self, north_m: float, east_m: float, down_m: float = 0.0) -> Location:
        """Return the point that lies so many metres from this one."""
        lat_step_deg = north_m / METRES_PER_DEGREE
        scale = _longitude_scale(self.lat_deg + 0.5 * lat_step_deg)
        lon_deg = self.lon_deg + east_m / (METRES_PER_DEGREE * scale)
        return Location(
            self.lat_deg + lat_step_deg, (lon_deg + 180.0) % 360.0 - 180.0, self.alt_amsl_m - down_m
        )

    def ned_to(self, other: Location) -> tuple[float, float, float]:
        """Return the metres north, east and down from this point to the other."""
        scale = _longitude_scale(0.5 * (self.lat_deg + other.lat_deg))
        lon_step_deg = (other.lon_deg - self.lon_deg + 180.0) % 360.0 - 180.0
        return (
            (other.lat_deg - self.lat_deg) * METRES_PER_DEGREE,
            lon_step_deg * METRES_PER_DEGREE * scale,
            self.alt_amsl_m - other.alt_amsl_m,
        )


def _longitude_scale(lat_deg: float) -> float:
    return max(cos(radians(lat_deg)), LONGITUDE_SCALE_MIN)
