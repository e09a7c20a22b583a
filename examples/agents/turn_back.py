"""An agent of one's own: fly out until the companion has not been heard for a second, then come back.

lostlink run examples/agents/turn_back.yaml
"""

from __future__ import annotations

import asyncio

from lostlink import Agent, GeodeticPosition, geodetic_from_ned


class TurnBack(Agent):
    """Knows where the link ends by losing it. Options: altitude_m, distance_m (at most), speed_mps, silence_s."""

    def on_tick(self, sim_time_ns: int) -> None:  # noqa: ARG002
        self.log("silence_s", self.silence_s())

    async def fly(self) -> None:
        home = await self.take_off(self.options["altitude_m"])
        start = GeodeticPosition(home.latitude_deg, home.longitude_deg, home.altitude_amsl_m)
        far = geodetic_from_ned(start, (self.options["distance_m"], 0.0, 0.0))
        self.ua.report("flies out")
        flight = asyncio.create_task(self.goto(far))
        silence = asyncio.create_task(
            self.ua.wait_for(lambda _: self.silence_s() > self.options["silence_s"])
        )
        await asyncio.wait({flight, silence}, return_when=asyncio.FIRST_COMPLETED)
        silence.cancel()
        if flight.done() and not flight.result():  # raises if the aircraft could not fly there
            await self.let_go()
            return
        flight.cancel()
        self.ua.report(f"turns back after {self.silence_s():.2f} s without a packet")
        if await self.goto(start):
            self.ua.report("is back")
        else:
            await self.let_go()

    async def goto(self, place: GeodeticPosition) -> bool:
        """Fly there; False if somebody else, such as an operator, gave another target."""
        return await self.ua.goto(
            place.lat_deg, place.lon_deg, self.options["altitude_m"], speed_mps=self.options["speed_mps"]
        )

    async def let_go(self) -> None:
        """Leave the aircraft to whoever took it over, until it has landed."""
        self.ua.report("yields to another target")
        await self.ua.wait_for(lambda state: not state.armed)

    def silence_s(self) -> float:
        """Sim time since the newest packet of anybody was sent."""
        newest_ns = max((package.header.stamp.ns for package in self.latest.values()), default=0)
        return (self.ua.sim_time_ns - newest_ns) / 1e9
