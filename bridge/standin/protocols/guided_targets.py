"""SET_POSITION_TARGET_* and DO_REPOSITION to targets of GUIDED, with their frames and type masks.

As in ArduCopter, what cannot be flown as asked stops the vehicle where it is.
"""

from __future__ import annotations

from math import isfinite

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridge.standin.control.quaternion import Vector
from bridge.standin.vehicle.location import ALT_MAX_M, Location
from bridge.standin.vehicle.mode_guided import Guided, GuidedTarget, ned_from_body
from bridge.standin.vehicle.vehicle import Vehicle
from bridge.standin.wire.mavlink_codec import Message

IGNORE_POSITION = 0b111
IGNORE_VELOCITY = 0b111 << 3
IGNORE_YAW = 1 << 10
IGNORE_YAW_RATE = 1 << 11
SPEED_SANE_MAX_MPS = 1000.0
POSITION_SANE_MAX_M = 1e6

OFFSET_FRAMES = frozenset(
    {dialect.MAV_FRAME_LOCAL_OFFSET_NED, dialect.MAV_FRAME_BODY_NED, dialect.MAV_FRAME_BODY_OFFSET_NED}
)
BODY_FRAMES = frozenset({dialect.MAV_FRAME_BODY_NED, dialect.MAV_FRAME_BODY_OFFSET_NED})
LOCAL_FRAMES = OFFSET_FRAMES | {dialect.MAV_FRAME_LOCAL_NED}
AMSL_FRAMES = frozenset({dialect.MAV_FRAME_GLOBAL, dialect.MAV_FRAME_GLOBAL_INT})
RELATIVE_FRAMES = frozenset(
    {dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT}
)


def fly_local_target(vehicle: Vehicle, message: Message) -> None:
    """Take a SET_POSITION_TARGET_LOCAL_NED; outside GUIDED it is ignored."""
    if isinstance(vehicle.mode, Guided):
        _fly(vehicle, vehicle.mode, _local_target(vehicle, message))


def fly_global_target(vehicle: Vehicle, message: Message) -> None:
    """Take a SET_POSITION_TARGET_GLOBAL_INT; outside GUIDED it is ignored."""
    if isinstance(vehicle.mode, Guided):
        _fly(vehicle, vehicle.mode, _global_target(vehicle, message))


def location_from(
    vehicle: Vehicle, lat_deg: float, lon_deg: float, alt_m: float, frame: int
) -> Location | None:
    """Return a location of a MAVLink frame with its height above sea level; None if it is not sane."""
    if not (isfinite(lat_deg) and isfinite(lon_deg) and abs(alt_m) <= ALT_MAX_M):
        return None
    if (
        abs(lat_deg) > 90.0
        or abs(lon_deg) > 180.0
        or (frame not in AMSL_FRAMES and frame not in RELATIVE_FRAMES)
    ):
        return None
    above_m = vehicle.home_or_origin.alt_amsl_m if frame in RELATIVE_FRAMES else 0.0
    return Location(lat_deg, lon_deg, alt_m + above_m)


def _fly(vehicle: Vehicle, mode: Guided, target: GuidedTarget | None) -> None:
    if target is not None:
        mode.fly(vehicle, target)
    elif not vehicle.landed:
        mode.enter(vehicle)
        vehicle.taking_off = False
        vehicle.navigator.stop()


def _local_target(vehicle: Vehicle, message: Message) -> GuidedTarget | None:
    mask, frame = message.type_mask, message.coordinate_frame
    if frame not in LOCAL_FRAMES:
        return None
    yaw_now_rad = vehicle.attitude_rad[2]
    position = None
    if mask & IGNORE_POSITION != IGNORE_POSITION:
        position = (message.x, message.y, message.z)
        if frame in BODY_FRAMES:
            position = (*ned_from_body(message.x, message.y, yaw_now_rad), message.z)
        if frame in OFFSET_FRAMES:
            north_m, east_m, down_m = vehicle.position_ned_m
            position = (position[0] + north_m, position[1] + east_m, position[2] + down_m)
    velocity = None
    if mask & IGNORE_VELOCITY != IGNORE_VELOCITY:
        velocity = (message.vx, message.vy, message.vz)
        if frame in BODY_FRAMES:
            velocity = (*ned_from_body(message.vx, message.vy, yaw_now_rad), message.vz)
    return _checked(position, velocity, *_yaw(message, yaw_now_rad if frame in BODY_FRAMES else 0.0))


def _global_target(vehicle: Vehicle, message: Message) -> GuidedTarget | None:
    mask = message.type_mask
    position = None
    if mask & IGNORE_POSITION != IGNORE_POSITION:
        location = location_from(
            vehicle, message.lat_int * 1e-7, message.lon_int * 1e-7, message.alt, message.coordinate_frame
        )
        if location is None:
            return None
        position = vehicle.origin.ned_to(location)
    velocity = None
    if mask & IGNORE_VELOCITY != IGNORE_VELOCITY:
        velocity = (message.vx, message.vy, message.vz)
    return _checked(position, velocity, *_yaw(message, 0.0))


def _yaw(message: Message, from_rad: float) -> tuple[float | None, float | None]:
    yaw_rad = None if message.type_mask & IGNORE_YAW else message.yaw + from_rad
    rate_radps = None if message.type_mask & IGNORE_YAW_RATE else message.yaw_rate
    return yaw_rad, rate_radps


def _checked(
    position: Vector | None, velocity: Vector | None, yaw_rad: float | None, yaw_rate_radps: float | None
) -> GuidedTarget | None:
    """Return the target if all its numbers are sane and there is something to fly."""
    numbers = [*(position or ()), *(velocity or ()), yaw_rad or 0.0, yaw_rate_radps or 0.0]
    if not all(isfinite(number) for number in numbers) or (position is None and velocity is None):
        return None
    if position is not None and any(abs(number) > POSITION_SANE_MAX_M for number in position):
        return None
    if velocity is not None and any(abs(number) > SPEED_SANE_MAX_MPS for number in velocity):
        return None
    return GuidedTarget(position, velocity, yaw_rad, yaw_rate_radps)
