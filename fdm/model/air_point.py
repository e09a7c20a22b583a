"""The air at a place and time: what flight models ask, and what every kind of wind answers."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from fdm.model.truth import Vector


class AirPoint(NamedTuple):
    """Where and when a wind is asked for."""

    sim_time_ns: int
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    height_m: float
    """Above the ground at home."""
    velocity_ned_mps: Vector
    """Of the UA, over the ground."""


class StaticAir(NamedTuple):
    """What barometer and thermometer measure, without errors."""

    pressure_pa: float
    temperature_k: float


class Wind(Protocol):
    """The wind of one UA."""

    def air_ned_mps(self, point: AirPoint) -> Vector:
        """Velocity of the air at `point`, NED m/s; called with times that do not decrease.

        Raises:
            WindError: the point is outside a wind map that forbids that.
        """
