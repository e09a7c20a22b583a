"""State of one UA (Table I of the paper): one frozen record, each field with its unit and its age."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from aps.timeouts import CONNECTED_S

NS_PER_S: Final = 1_000_000_000
NAN: Final = math.nan

Vector3 = tuple[float, float, float]
NO_VECTOR: Final[Vector3] = (NAN, NAN, NAN)
LandedState = str
"""``undefined``, ``on_ground``, ``in_air``, ``takeoff`` or ``landing``. Who flew and disarms is ``undefined`` until the
autopilot says anew."""
FLYING: Final[frozenset[LandedState]] = frozenset({"takeoff", "in_air", "landing"})


@dataclass(frozen=True, slots=True)
class VehicleState:
    """Table I of the paper, with a few more fields that commands need.

    Angles are radians of the body (FRD) in NED, positions geodetic (WGS 84) or NED metres from the
    autopilot's local origin, velocities NED over ground.
    """

    sysid: int
    vehicle_type: int = 0
    """MAV_TYPE of the autopilot's heartbeat."""
    autopilot: int = 0
    """MAV_AUTOPILOT of the heartbeat: 3 ArduPilot, 12 PX4."""
    time_boot_ms: int = 0
    """The autopilot's own clock (sim time of this boot), from its newest message."""
    roll_rad: float = NAN
    pitch_rad: float = NAN
    yaw_rad: float = NAN
    lat_deg: float = NAN
    lon_deg: float = NAN
    alt_amsl_m: float = NAN
    alt_rel_m: float = NAN
    """Above home."""
    position_ned_m: Vector3 = NO_VECTOR
    velocity_ned_mps: Vector3 = NO_VECTOR
    indicated_airspeed_mps: float = NAN
    groundspeed_mps: float = NAN
    airspeed_mps: float = NAN
    """True airspeed: velocity over ground minus wind, as long as the autopilot estimates wind; else the
    indicated airspeed."""
    wind_ned_mps: Vector3 = NO_VECTOR
    """The air's velocity over ground (where it blows to)."""
    mode: str = ""
    base_mode: str = ""
    """MAV_MODE_FLAG labels joined by ``|``."""
    armed: bool = False
    ready_to_arm: bool = False
    """The autopilot's own pre-arm verdict, for the mode it is in (ArduCopter asks for a position only in
    modes that need one). True while armed."""
    position_ok: bool = False
    """The autopilot's estimator has an absolute horizontal position (EKF_STATUS_REPORT; PX4:
    ESTIMATOR_STATUS)."""
    system_status: str = ""
    """MAV_STATE label: BOOT, STANDBY, ACTIVE, CRITICAL, ..."""
    landed_state: LandedState = "undefined"
    vtol: bool = False
    """It takes off and lands upright (EXTENDED_SYS_STATE). ArduPlane's QuadPlane calls itself a fixed wing in its
    heartbeat, unless Q_MAV_TYPE says otherwise."""
    heartbeat_age_s: float = math.inf
    """Seconds of the daemon's clock (wall time, or sim time in held mode) since the autopilot's last heartbeat."""
    link_open: bool = True
    """Whether a link leads to the autopilot: not while its device is unplugged or its connection refused."""
    flight_time_s: float = 0.0
    """Time in the air in this (else the latest) flight, by the autopilot's clock."""
    voltage_v: float = NAN
    current_a: float = NAN
    battery_remaining_percent: float = NAN
    throttle_percent: float = NAN
    climb_mps: float = NAN
    gps_fix_type: int = 0
    satellites_visible: int = 0
    mission_current: int = -1
    """Number of the item that is flown to, as the autopilot counts (ArduPilot: item 0 is home)."""
    mission_total: int = -1
    """Number of the last item (PX4 counts from 0); -1 where the autopilot does not say."""
    mission_state: str = ""
    """MISSION_STATE label: NO_MISSION, NOT_STARTED, ACTIVE, PAUSED, COMPLETE; empty where the autopilot does not
    say."""
    mission_reached: int = -1
    """Number of the item that was reached last."""
    waypoint_distance_m: float = NAN
    """Horizontal distance to the autopilot's active target (NAV_CONTROLLER_OUTPUT)."""
    home_lat_deg: float = NAN
    home_lon_deg: float = NAN
    home_alt_amsl_m: float = NAN
    as_of_ns: int = 0
    """The daemon's clock when this state was taken ..."""
    heard_ns: Mapping[int, int] = field(default_factory=dict, repr=False)
    """... and when each message that feeds it was last heard, by message id."""

    def age_s(self, name: str) -> float:
        """How old a field is, s of the daemon's clock: since the newest message that has it; infinite if none came.

        A field of several sources (true airspeed of velocity and wind) is as old as the oldest of them.

        Raises:
            ValueError: the state has no such field, or it is no measurement.
        """
        if name not in _SOURCES:
            raise ValueError(f"{name!r} is no measured field of the state: {', '.join(_SOURCES)}")
        heard_ns, oldest_ns = self.heard_ns, self.as_of_ns
        for choice in _SOURCES[name]:
            newest_ns = -1
            for msg_id in choice:
                newest_ns = max(newest_ns, heard_ns.get(msg_id, -1))
            if newest_ns < 0:
                return math.inf
            oldest_ns = min(oldest_ns, newest_ns)
        return (self.as_of_ns - oldest_ns) / NS_PER_S

    def ages_s(self) -> dict[str, float]:
        """The age of every measured field; see ``age_s``."""
        return {name: self.age_s(name) for name in _SOURCES}

    @property
    def wind_body_mps(self) -> Vector3:
        """Table I's wx, wy, wz: the wind in body axes (FRD)."""
        return _body_from_ned(self.wind_ned_mps, self.roll_rad, self.pitch_rad, self.yaw_rad)

    @property
    def connected(self) -> bool:
        """Whether a link leads to the autopilot, and it has been heard within CONNECTED_S."""
        return self.link_open and self.heartbeat_age_s < CONNECTED_S


def _body_from_ned(vector: Vector3, roll_rad: float, pitch_rad: float, yaw_rad: float) -> Vector3:
    """Rotate NED to body axes by the aerospace yaw-pitch-roll sequence."""
    north, east, down = vector
    cos_yaw, sin_yaw = math.cos(yaw_rad), math.sin(yaw_rad)
    cos_pitch, sin_pitch = math.cos(pitch_rad), math.sin(pitch_rad)
    cos_roll, sin_roll = math.cos(roll_rad), math.sin(roll_rad)
    ahead, right = cos_yaw * north + sin_yaw * east, cos_yaw * east - sin_yaw * north
    low = sin_pitch * ahead + cos_pitch * down
    return (
        cos_pitch * ahead - sin_pitch * down,
        cos_roll * right + sin_roll * low,
        cos_roll * low - sin_roll * right,
    )


_POSITION: Final = ((33,),)
_SOURCES: Final[Mapping[str, tuple[tuple[int, ...], ...]]] = {
    **dict.fromkeys(("vehicle_type", "autopilot", "mode", "base_mode", "armed", "system_status"), ((0,),)),
    **dict.fromkeys(("ready_to_arm", "voltage_v", "battery_remaining_percent"), ((1,),)),
    **dict.fromkeys(("gps_fix_type", "satellites_visible"), ((24,),)),
    **dict.fromkeys(("roll_rad", "pitch_rad", "yaw_rad"), ((30,),)),
    "position_ned_m": ((32,),),
    "velocity_ned_mps": ((32, 33),),
    **dict.fromkeys(("lat_deg", "lon_deg", "alt_amsl_m", "alt_rel_m"), _POSITION),
    **dict.fromkeys(("mission_current", "mission_total", "mission_state"), ((42,),)),
    "mission_reached": ((46,),),
    "waypoint_distance_m": ((62,),),
    **dict.fromkeys(
        ("indicated_airspeed_mps", "groundspeed_mps", "climb_mps", "throttle_percent"),
        ((74,),),
    ),
    "airspeed_mps": ((32, 33, 74), (168, 231, 74)),  # the indicated one where there is no wind
    "current_a": ((1, 147),),
    "wind_ned_mps": ((168, 231),),
    "wind_body_mps": ((30,), (168, 231)),
    "position_ok": ((193, 230),),
    **dict.fromkeys(("home_lat_deg", "home_lon_deg", "home_alt_amsl_m"), ((242,),)),
    "landed_state": ((245,),),
    "vtol": ((245,),),
    "time_boot_ms": ((2, 30, 32, 33),),
    "flight_time_s": ((2, 30, 32, 33),),
}
"""Field -> the sources that it needs, each a choice of message ids."""
