"""Follow another UA by what it transmits: its position and velocity, as old as the newest packet heard.

lostlink run examples/agents/leader_follower.yaml
"""

from __future__ import annotations

import asyncio

from lostlink import Agent, GeodeticPosition, geodetic_from_ned

LEADER = "0"


class Follower(Agent):
    """Options: altitude_m, behind_m (south of where the leader is)."""

    async def fly(self) -> None:
        await self.take_off(self.options["altitude_m"])
        self.ua.report("follows")
        async for _ in self.every(0.5):
            heard = self.latest.get(LEADER)
            if heard is None or not heard.state.armed:
                continue
            place, speed = heard.state, heard.state.velocity_ned_mps
            leader = GeodeticPosition(place.latitude_deg, place.longitude_deg, place.altitude_amsl_m)
            target = geodetic_from_ned(leader, (-self.options["behind_m"], 0.0, 0.0))
            self.steering = asyncio.create_task(  # a newer target takes over
                self.ua.follow(
                    target.lat_deg,
                    target.lon_deg,
                    self.options["altitude_m"],
                    velocity_ned_mps=(speed.x, speed.y, 0.0),
                )
            )
