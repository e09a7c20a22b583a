"""Flies straight out and back."""

from __future__ import annotations

import math

from bridge.agents.shipped.yielding import Yielding
from bridge.bus.messages import AircraftState, Waypoint
from bridge.scenario.agents import OutAndBackAgent
from fdm.model.geodesy import GeodeticPosition, geodetic_from_ned


class OutAndBack(Yielding):
    """Climbs, flies ``distance_m`` along ``bearing_deg`` from home, turns and comes back."""

    async def mission(self) -> None:
        """Take off, fly out, fly back."""
        config = self.config.agent
        assert isinstance(config, OutAndBackAgent)
        home = await self.take_off(config.altitude_m)
        self.waypoints = _waypoints(home, config)
        for activity, point in zip(("flies out", "flies back"), self.waypoints, strict=True):
            self.ua.report(f"{activity} at {config.speed_mps:g} m/s")
            is_there = await self.ua.goto(
                point.latitude_deg, point.longitude_deg, point.altitude_rel_m, speed_mps=config.speed_mps
            )
            if not is_there:
                await self.let_go("another target took the place of its own")
                return
        self.ua.report("is back")


def _waypoints(home: AircraftState, config: OutAndBackAgent) -> tuple[Waypoint, Waypoint]:
    """The far point and the point over home."""
    start = GeodeticPosition(home.latitude_deg, home.longitude_deg, home.altitude_amsl_m)
    bearing_rad = math.radians(config.bearing_deg)
    north_m, east_m = config.distance_m * math.cos(bearing_rad), config.distance_m * math.sin(bearing_rad)
    far = geodetic_from_ned(start, (north_m, east_m, 0.0))
    return (
        Waypoint(far.lon_deg, far.lat_deg, config.altitude_m),
        Waypoint(start.lon_deg, start.lat_deg, config.altitude_m),
    )
