"""An agent that flies a mission, and returns by the autopilot's own way."""

from __future__ import annotations

from bridge.agents import Agent
from fdm.model.geodesy import GeodeticPosition, geodetic_from_ned

HEIGHT_M, SIDE_M = 20.0, 40.0
CORNERS = ((SIDE_M, 0.0), (SIDE_M, SIDE_M), (0.0, SIDE_M))
"""North and east of home, metres."""


class MissionAndReturn(Agent):
    """Three corners of a square as a mission, then RTL down to the ground."""

    async def fly(self) -> None:
        home = await self.take_off(HEIGHT_M)
        start = GeodeticPosition(home.latitude_deg, home.longitude_deg, home.altitude_amsl_m)
        places = [geodetic_from_ned(start, (*corner, 0.0)) for corner in CORNERS]
        await self.ua.mission(
            {"command": "NAV_WAYPOINT", "params": [0, 0, 0, None, place.lat_deg, place.lon_deg, HEIGHT_M]}
            for place in places
        )
        self.ua.report("has flown its mission")
        await self.ua.rtl()
        self.ua.report("has landed")
