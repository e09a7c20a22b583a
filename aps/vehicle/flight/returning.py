"""Whether a plane that returns is where it goes on circling."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from aps.vehicle.flight.steps import horizontal_distance_m, is_fixed_wing
from aps.vehicle.state import VehicleState
from aps.wire.dialect import ARDUPILOT, is_plane, mavlink

PLANE_RADIUS_M: Final = 200.0
"""A fixed wing circles its target, at ArduPlane's WP_LOITER_RAD (60 m unless set, 120 m for our Aerosonde) and wider
while it turns in: within this of it counts as there."""
WAY_M: Final = 2.0
WAY_LAG_S: Final = 1.5
"""From the way to go that the autopilot says, in whole metres and once a second, to the way that is left."""
_HEARTBEAT: Final = int(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
_WAY: Final = int(mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT)


class Returning:
    """A return: home, or with ArduPlane to a rally point, if there is one. It says how far it has to go.

    Args:
        modes: in which it returns.
    """

    def __init__(self, modes: Sequence[str]) -> None:
        self._modes = modes
        self._since_ns: int | None = None
        """When the heartbeat came that first showed one of them."""

    def is_there(self, now: VehicleState) -> bool:
        """Whether it circles there; of what does not circle, never."""
        if now.mode not in self._modes:
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = now.heard_ns.get(_HEARTBEAT, 0)
        return _circles(now) and self.way_m(now) <= PLANE_RADIUS_M

    def way_m(self, now: VehicleState) -> float:
        """How far that is over ground; NaN where it is not known yet."""
        home_m = horizontal_distance_m(now, now.home_lat_deg, now.home_lon_deg)
        if now.autopilot != ARDUPILOT or not _circles(now) or math.isnan(now.waypoint_distance_m):
            return home_m
        if self._since_ns is None or now.heard_ns.get(_WAY, -1) <= self._since_ns:
            return math.nan
        goes_home = abs(now.waypoint_distance_m - home_m) <= WAY_M + WAY_LAG_S * now.groundspeed_mps
        return home_m if goes_home else now.waypoint_distance_m


def _circles(now: VehicleState) -> bool:
    """Whether a return ends in a circle: of a fixed wing, and of ArduPlane's QuadPlane, as it comes (Q_RTL_MODE)."""
    return is_fixed_wing(now) or (now.autopilot == ARDUPILOT and is_plane(now.vehicle_type))
