"""An agent of one's own in sim time: wander at random, beacon at random, and count who was heard.

lostlink run examples/agents/wander.yaml

Everything here repeats byte for byte: sleeps and timeouts wait in sim time, `self.rng` is seeded by run and node.
"""

from __future__ import annotations

import asyncio

from lostlink import Agent, CommandFailed, CommandInterrupted, GeodeticPosition, geodetic_from_ned


class Wander(Agent):
    """Options: altitude_m, legs, radius_m, speed_mps, leg_s (at most, per leg)."""

    async def fly(self) -> None:
        self.beacons = asyncio.create_task(self.beacon())
        self.counts = asyncio.create_task(self.count())
        await self.sleep(self.rng.uniform(0.0, 2.0))  # not all at once
        home = await self.take_off(self.options["altitude_m"])
        start = GeodeticPosition(home.latitude_deg, home.longitude_deg, home.altitude_amsl_m)
        for leg in range(self.options["legs"]):
            north_m, east_m = self.rng.uniform(-1.0, 1.0, 2) * self.options["radius_m"]
            self.ua.report(f"flies leg {leg + 1}: {north_m:.0f} m north, {east_m:.0f} m east")
            if not await self.fly_to(geodetic_from_ned(start, (north_m, east_m, 0.0))):
                self.ua.report("yields")  # to an operator: the aircraft is theirs until it has landed
                await self.ua.wait_for(lambda state: not state.armed)
                break
        self.beacons.cancel()
        self.counts.cancel()

    async def fly_to(self, place: GeodeticPosition) -> bool:
        """Fly there, or as far as the time for a leg lets it; False if somebody else took it over."""
        try:
            async with asyncio.timeout(self.options["leg_s"]):
                return await self.ua.goto(
                    place.lat_deg,
                    place.lon_deg,
                    self.options["altitude_m"],
                    speed_mps=self.options["speed_mps"],
                )
        except TimeoutError:
            self.ua.report("turns early")
        except CommandInterrupted:
            return False
        except CommandFailed as error:
            self.ua.report(f"goes on: {error}")
        return True

    async def beacon(self) -> None:
        """Transmit a few random bytes now and then."""
        while True:
            await self.sleep(self.rng.exponential(0.3))
            self.ua.transmit("beacon", self.rng.bytes(8))

    async def count(self) -> None:
        """Report once in ten seconds who was heard since."""
        async for now_s in self.every(10.0):
            heard = sorted(
                node for node, p in self.latest.items() if p.header.stamp.ns > (now_s - 10.0) * 1e9
            )
            self.ua.transmit("heard", ",".join(heard).encode())
