"""What a client would have the vehicle fly: SET_POSITION_TARGET_* for GUIDED, and where the throttle stick is.

A target is a point, a velocity or a point that moves, in a local frame or on the earth. As in ArduCopter, what cannot
be flown as asked stops the vehicle where it is. Accelerations are not taken.
"""

from __future__ import annotations

from math import cos, isfinite, sin

from pymavlink.dialects.v20 import ardupilotmega as dialect

from standin.control.quaternion import Vector, wrapped
from standin.vehicle.location import ALT_MAX_M, Location
from standin.vehicle.mission import RELATIVE_FRAMES, MissionFrame
from standin.vehicle.modes import ZERO, Guided, Nose
from standin.vehicle.vehicle import StandinVehicle
from standin.wire.mavlink_codec import Message

IGNORE_POSITION = 0b111
IGNORE_VELOCITY = 0b111 << 3
BODY_FRAMES = (dialect.MAV_FRAME_BODY_NED, dialect.MAV_FRAME_BODY_OFFSET_NED)
"""Points and velocities ahead and to the right; the yaw is a turn from where the nose is held."""
OFFSET_FRAMES = (dialect.MAV_FRAME_LOCAL_OFFSET_NED, *BODY_FRAMES)
"""Points are as seen from the vehicle."""
SPEED_SANE_MAX_MPS = 1000.0
POSITION_SANE_MAX_M = 1e6
GCS_SYSID = 255
"""MAV_GCS_SYSID: whose sticks are obeyed."""
UNCHANGED_US = 65535


def fly_local_target(vehicle: StandinVehicle, message: Message) -> None:
    """Take a SET_POSITION_TARGET_LOCAL_NED; outside GUIDED it is ignored."""
    mode, mask = vehicle.mode, message.type_mask
    if not isinstance(mode, Guided):
        return
    position = None if mask & IGNORE_POSITION else (message.x, message.y, message.z)
    frame = message.coordinate_frame
    known = frame == dialect.MAV_FRAME_LOCAL_NED or frame in OFFSET_FRAMES
    if not known or not _sane(position or ZERO, POSITION_SANE_MAX_M):
        mode.stop()
        return
    if position is not None and frame in OFFSET_FRAMES:
        offset = _turned(vehicle, position) if frame in BODY_FRAMES else position
        north_m, east_m, down_m = vehicle.position_ned_m
        position = (north_m + offset[0], east_m + offset[1], down_m + offset[2])
    _fly(vehicle, mode, position, message, by_body=frame in BODY_FRAMES)


def fly_global_target(vehicle: StandinVehicle, message: Message) -> None:
    """Take a SET_POSITION_TARGET_GLOBAL_INT; outside GUIDED it is ignored."""
    mode = vehicle.mode
    if not isinstance(mode, Guided):
        return
    place = (message.lat_int * 1e-7, message.lon_int * 1e-7, message.alt)
    location = location_from(vehicle, *place, message.coordinate_frame)
    if message.type_mask & IGNORE_POSITION:
        _fly(vehicle, mode, None, message)
    elif location is None:
        mode.stop()
    else:
        _fly(vehicle, mode, vehicle.origin.ned_to(location), message)


def _turned(vehicle: StandinVehicle, vector: Vector) -> Vector:
    """Return north, east and down of what is given ahead, to the right and down."""
    cos_yaw, sin_yaw = cos(vehicle.attitude_rad[2]), sin(vehicle.attitude_rad[2])
    ahead, right, down = vector
    return (cos_yaw * ahead - sin_yaw * right, sin_yaw * ahead + cos_yaw * right, down)


def _fly(
    vehicle: StandinVehicle,
    mode: Guided,
    position: Vector | None,
    message: Message,
    *,
    by_body: bool = False,
) -> None:
    """Fly the point, the velocity or both that a message has; velocity and yaw go by the nose with ``by_body``."""
    mask = message.type_mask
    velocity = None if mask & IGNORE_VELOCITY else (message.vx, message.vy, message.vz)
    yaw_rad = None if mask & dialect.POSITION_TARGET_TYPEMASK_YAW_IGNORE else message.yaw
    turn_radps = None if mask & dialect.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE else message.yaw_rate
    if by_body and velocity is not None:
        velocity = _turned(vehicle, velocity)
    if by_body and yaw_rad is not None:
        yaw_rad = wrapped(vehicle.navigator.yaw_rad + yaw_rad)
    nose = Nose(yaw_rad, turn_radps)
    if velocity is not None and not _sane(velocity, SPEED_SANE_MAX_MPS):
        mode.stop()
    elif position is not None:
        mode.fly_to(position, velocity, nose)
    elif velocity is not None:
        mode.fly_velocity(velocity, nose)
    else:
        mode.stop()


def hold_sticks(vehicle: StandinVehicle, message: Message) -> None:
    """Take the throttle of RC_CHANNELS_OVERRIDE or MANUAL_CONTROL, from the ground station alone, as ArduPilot."""
    if message.get_srcSystem() != GCS_SYSID:
        return
    if message.get_type() == "MANUAL_CONTROL":
        if 0 <= message.z <= 1000 and message.target == vehicle.parameters["MAV_SYSID"]:
            vehicle.sticks.hold(message.z / 1000.0, vehicle.sim_time_ns)
    elif message.chan3_raw == 0:
        vehicle.sticks.release()
    elif message.chan3_raw != UNCHANGED_US:
        vehicle.sticks.hold((message.chan3_raw - 1000.0) / 1000.0, vehicle.sim_time_ns)


def location_from(
    vehicle: StandinVehicle, lat_deg: float, lon_deg: float, alt_m: float, frame: int
) -> Location | None:
    """Return a location of a MAVLink frame with its height above sea level; None if it is not sane."""
    if frame not in tuple(MissionFrame) or frame == MissionFrame.MISSION:
        return None
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0 and abs(alt_m) < ALT_MAX_M):
        return None
    above_m = vehicle.home_or_origin.alt_amsl_m if frame in RELATIVE_FRAMES else 0.0
    return Location(lat_deg, lon_deg, alt_m + above_m)


def _sane(vector: Vector, limit: float) -> bool:
    return all(isfinite(number) and abs(number) <= limit for number in vector)
