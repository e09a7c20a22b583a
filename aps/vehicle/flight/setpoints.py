"""Setpoints and other messages that say where to fly to in GUIDED."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

from aps.timeouts import LANDING_TIMEOUT_S
from aps.vehicle.commands import Step
from aps.vehicle.execution import Refusal
from aps.vehicle.flight.plans import EARTH_RADIUS_M, SLOWEST_MPS, ardupilot_only, checked, mode_step
from aps.vehicle.telemetry import Vector3, VehicleState
from aps.wire.dialect import AUTOPILOT_COMPID, is_plane, mavlink

__all__ = [
    "ZERO",
    "Yaw",
    "global_setpoint",
    "guided",
    "leg_s",
    "local_setpoint",
    "offset_deg",
    "place_of",
    "reposition_step",
    "setpoints_only",
    "stop",
]

# POSITION_TARGET_TYPEMASK: bits of what is to be ignored.
_NO_POSITION: Final = 0x007
_NO_VELOCITY: Final = 0x038
_NO_ACCELERATION: Final = 0x1C0
_NO_YAW: Final = 0x400
_NO_YAW_RATE: Final = 0x800
ZERO: Final[Vector3] = (0.0, 0.0, 0.0)


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
    mask |= _NO_POSITION if position_m is None else 0
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


def global_setpoint(
    state: VehicleState, lat_deg: float, lon_deg: float, alt_rel_m: float, velocity_mps: Vector3, yaw: Yaw
) -> Any:
    """SET_POSITION_TARGET_GLOBAL_INT with height above home."""
    return mavlink.MAVLink_set_position_target_global_int_message(
        state.time_boot_ms & 0xFFFFFFFF,
        state.sysid,
        AUTOPILOT_COMPID,
        mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        _NO_ACCELERATION | yaw.mask,
        round(lat_deg * 1e7),
        round(lon_deg * 1e7),
        alt_rel_m,
        *velocity_mps,
        *ZERO,
        *yaw.fields,
    )


def guided(state: VehicleState) -> tuple[Step, ...]:
    """The step into GUIDED, unless it flies in it."""
    return () if state.mode == "GUIDED" else (mode_step(state, "GUIDED"),)


def setpoints_only(state: VehicleState, verb: str) -> None:
    """Refuse to send setpoints to what takes none.

    Raises:
        Refusal: a plane, or another autopilot than ArduPilot.
    """
    ardupilot_only(state, verb)
    if is_plane(state.vehicle_type):
        raise Refusal(f"ArduPlane takes no setpoints of this kind: {verb} is for copters, rovers and boats")


def offset_deg(lat_deg: float, lon_deg: float, north_m: float, east_m: float) -> tuple[float, float]:
    """Latitude and longitude of a point some metres away, flat around it."""
    shrink = max(1e-9, math.cos(math.radians(lat_deg)))
    lon = lon_deg + math.degrees(east_m / EARTH_RADIUS_M / shrink)
    return lat_deg + math.degrees(north_m / EARTH_RADIUS_M), (lon + 180.0) % 360.0 - 180.0


def place_of(
    lat_deg: float, lon_deg: float, height_m: float, name: str = "alt_rel_m"
) -> tuple[float, float, float]:
    """Latitude, longitude and height, checked.

    Raises:
        ValueError: one is out of range.
    """
    lat = checked("lat_deg", lat_deg, -90.0, 90.0)
    lon = checked("lon_deg", lon_deg, -180.0, 180.0)
    return lat, lon, checked(name, height_m, -1000.0, 10_000.0)


def leg_s(distance_m: float) -> float:
    """Time to allow for a leg, s."""
    return 60.0 + (distance_m / SLOWEST_MPS if math.isfinite(distance_m) else LANDING_TIMEOUT_S)


def reposition_step(
    state: VehicleState, frame: int, place: tuple[float, float, float], radius_m: float = 0.0
) -> Step:
    """DO_REPOSITION; a plane circles with ``radius_m``, negative to the left, 0 as it is set."""
    command = int(mavlink.MAV_CMD_DO_REPOSITION)
    lat_deg, lon_deg, height_m = place

    def message(_: int) -> Any:
        return mavlink.MAVLink_command_int_message(
            state.sysid,
            AUTOPILOT_COMPID,
            frame,
            command,
            0,
            0,
            -1.0,
            float(mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE),
            radius_m,
            math.nan,
            round(lat_deg * 1e7),
            round(lon_deg * 1e7),
            height_m,
        )

    return Step(message, command=command)


def stop(state: VehicleState) -> list[Any]:
    """Have a copter stop where it is."""
    return [local_setpoint(state, mavlink.MAV_FRAME_LOCAL_NED, None, ZERO, Yaw())]
