"""SET_POSITION_TARGET_*: a point or a velocity in LOCAL_NED, or a point on the earth, for GUIDED.

As in ArduCopter, what cannot be flown as asked stops the vehicle where it is. Yaw is not taken.
"""

from __future__ import annotations

from math import isfinite

from pymavlink.dialects.v20 import ardupilotmega as dialect

from standin.control.quaternion import Vector
from standin.vehicle.location import ALT_MAX_M, Location
from standin.vehicle.mission import RELATIVE_FRAMES, MissionFrame
from standin.vehicle.modes import Guided
from standin.vehicle.vehicle import StandinVehicle
from standin.wire.mavlink_codec import Message

IGNORE_POSITION = 0b111
IGNORE_VELOCITY = 0b111 << 3
SPEED_SANE_MAX_MPS = 1000.0
POSITION_SANE_MAX_M = 1e6


def fly_local_target(vehicle: StandinVehicle, message: Message) -> None:
    """Take a SET_POSITION_TARGET_LOCAL_NED; outside GUIDED it is ignored."""
    mode, mask = vehicle.mode, message.type_mask
    if not isinstance(mode, Guided):
        return
    position, velocity = (message.x, message.y, message.z), (message.vx, message.vy, message.vz)
    known = message.coordinate_frame == dialect.MAV_FRAME_LOCAL_NED
    if known and not mask & IGNORE_POSITION and _sane(position, POSITION_SANE_MAX_M):
        mode.fly_to(vehicle, position)
    elif (
        known
        and mask & IGNORE_POSITION
        and not mask & IGNORE_VELOCITY
        and _sane(velocity, SPEED_SANE_MAX_MPS)
    ):
        mode.fly_velocity(vehicle, velocity)
    else:
        mode.stop(vehicle)


def fly_global_target(vehicle: StandinVehicle, message: Message) -> None:
    """Take a SET_POSITION_TARGET_GLOBAL_INT; outside GUIDED it is ignored."""
    mode = vehicle.mode
    if not isinstance(mode, Guided):
        return
    place = (message.lat_int * 1e-7, message.lon_int * 1e-7, message.alt)
    location = location_from(vehicle, *place, message.coordinate_frame)
    if location is None or message.type_mask & IGNORE_POSITION:
        mode.stop(vehicle)
    else:
        mode.fly_to(vehicle, vehicle.origin.ned_to(location))


def location_from(
    vehicle: StandinVehicle, lat_deg: float, lon_deg: float, alt_m: float, frame: int
) -> Location | None:
    """Return a location of a MAVLink frame with its height above sea level; None if it is not sane."""
    if frame not in tuple(MissionFrame) or frame == MissionFrame.MISSION:
        return None
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0 and abs(alt_m) <= ALT_MAX_M):
        return None
    above_m = vehicle.home_or_origin.alt_amsl_m if frame in RELATIVE_FRAMES else 0.0
    return Location(lat_deg, lon_deg, alt_m + above_m)


def _sane(vector: Vector, limit: float) -> bool:
    return all(isfinite(number) and abs(number) <= limit for number in vector)
