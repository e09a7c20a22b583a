"""Flies a mission, and comes back by the autopilot's own return. Options: height_m, corners (north and east, m)."""

from __future__ import annotations

from lostlink import Agent, GeodeticPosition, geodetic_from_ned


class MissionAndReturn(Agent):
    """The corners as a mission, then RTL down to the ground."""

    async def fly(self) -> None:
        height_m = self.options["height_m"]
        home = await self.take_off(height_m)
        start = GeodeticPosition(home.latitude_deg, home.longitude_deg, home.altitude_amsl_m)
        places = [geodetic_from_ned(start, (*corner, 0.0)) for corner in self.options["corners"]]
        await self.ua.mission(
            {"command": "NAV_WAYPOINT", "params": [0, 0, 0, None, place.lat_deg, place.lon_deg, height_m]}
            for place in places
        )
        self.ua.report("has flown its mission")
        await self.ua.rtl()
        self.ua.report("has landed")
