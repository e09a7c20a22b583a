"""Setpoints: messages without an acknowledgement that say where to fly to, and what they are made of."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

from aps.timeouts import LANDING_TIMEOUT_S
from aps.vehicle.flight.steps import EARTH_RADIUS_M, checked
from aps.vehicle.state import Vector3, VehicleState
from aps.wire.dialect import AUTOPILOT_COMPID, mavlink

# POSITION_TARGET_TYPEMASK: bits of what is to be ignored.
NO_POSITION: Final = 0x007
_NO_VELOCITY: Final = 0x038
_NO_ACCELERATION: Final = 0x1C0
_NO_YAW: Final = 0x400
_NO_YAW_RATE: Final = 0x800
ZERO: Final[Vector3] = (0.0, 0.0, 0.0)
SLOWEST_MPS: Final = 0.5
"""For time-outs: a leg that is flown slower than this has failed."""
Place = tuple[float, float, float]
"""Latitude, longitude, degrees, and height, m."""


@dataclass(frozen=True, slots=True)
class Yaw:
    """Where the nose is to point: a heading, a rate of turn, or as the autopilot likes."""

    yaw_deg: float | None = None
    rate_dps: float | None = None

    def __post_init__(self) -> None:
        if self.yaw_deg is not None:
            checked("yaw_deg", self.yaw_deg, -360.0, 360.0)
        if self.rate_dps is not None:
            checked("yaw_rate_dps", self.rate_dps, -360.0, 360.0)
        if self.yaw_deg is not None and self.rate_dps is not None:
            raise ValueError("yaw_deg and yaw_rate_dps exclude each other")

    @property
    def mask(self) -> int:
        """POSITION_TARGET_TYPEMASK bits of what is not given."""
        return (_NO_YAW if self.yaw_deg is None else 0) | (_NO_YAW_RATE if self.rate_dps is None else 0)

    @property
    def fields(self) -> tuple[float, float]:
        """Yaw, rad, and its rate, rad/s, as the messages carry them."""
        return math.radians(self.yaw_deg or 0.0), math.radians(self.rate_dps or 0.0)


def local_setpoint(
    state: VehicleState, frame: int, position_m: Vector3 | None, velocity_mps: Vector3 | None, yaw: Yaw
) -> Any:
    """SET_POSITION_TARGET_LOCAL_NED; what is ``None`` is left to the autopilot."""
    mask = _NO_ACCELERATION | yaw.mask
    mask |= NO_POSITION if position_m is None else 0
    mask |= _NO_VELOCITY if velocity_mps is None else 0
    return mavlink.MAVLink_set_position_target_local_ned_message(
        state.time_boot_ms & 0xFFFFFFFF,
        state.sysid,
        AUTOPILOT_COMPID,
        frame,
        mask,
        *(position_m or ZERO),
        *(velocity_mps or ZERO),
        *ZERO,
        *yaw.fields,
    )


def global_setpoint(state: VehicleState, frame: int, place: Place, velocity_mps: Vector3, yaw: Yaw) -> Any:
    """SET_POSITION_TARGET_GLOBAL_INT; what the height counts from is said by the MAV_FRAME."""
    lat_deg, lon_deg, height_m = place
    return mavlink.MAVLink_set_position_target_global_int_message(
        state.time_boot_ms & 0xFFFFFFFF,
        state.sysid,
        AUTOPILOT_COMPID,
        frame,
        _NO_ACCELERATION | yaw.mask,
        round(lat_deg * 1e7),
        round(lon_deg * 1e7),
        height_m,
        *velocity_mps,
        *ZERO,
        *yaw.fields,
    )


def offset_deg(lat_deg: float, lon_deg: float, north_m: float, east_m: float) -> tuple[float, float]:
    """Latitude and longitude of a point some metres away, flat around it."""
    shrink = max(1e-9, math.cos(math.radians(lat_deg)))
    lon = lon_deg + math.degrees(east_m / EARTH_RADIUS_M / shrink)
    return lat_deg + math.degrees(north_m / EARTH_RADIUS_M), (lon + 180.0) % 360.0 - 180.0


def place_of(lat_deg: float, lon_deg: float, height_m: float, name: str = "alt_rel_m") -> Place:
    """Latitude, longitude and height, checked.

    Raises:
        ValueError: one is out of range, or it is 0 N 0 E, which ArduPilot takes for where it is.
    """
    lat = checked("lat_deg", lat_deg, -90.0, 90.0)
    lon = checked("lon_deg", lon_deg, -180.0, 180.0)
    if round(lat * 1e7) == 0 == round(lon * 1e7):
        raise ValueError(
            "lat_deg and lon_deg are both 0, which names no place: give the latitude and longitude to fly to"
        )
    return lat, lon, checked(name, height_m, -1000.0, 10_000.0)


def leg_s(distance_m: float) -> float:
    """Time to allow for a leg, s."""
    return 60.0 + (distance_m / SLOWEST_MPS if math.isfinite(distance_m) else LANDING_TIMEOUT_S)
