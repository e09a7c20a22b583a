"""A relay that keeps at a share of the way to the UA that it hears, and what that is worth."""

from __future__ import annotations

import asyncio
from contextlib import suppress

from lostlink import Agent, CommandFailed, Run

LATE_S = 30.0


class Follow(Agent):
    """Options: height_m, share (of the way to UA 0), gain_per_s (of speed by distance)."""

    async def fly(self) -> None:
        await self.take_off(self.options["height_m"])
        async for _ in self.every(0.5):
            if "0" in self.latest:
                self.steering = asyncio.create_task(self.steer(self.wanted_mps()))

    def wanted_mps(self) -> float:
        leader = self.latest["0"].state
        place = (leader.latitude_deg, leader.longitude_deg, leader.altitude_amsl_m)
        north_m, _, _ = self.ua.frames.fleet_from_earth(*place)
        short_m = self.options["share"] * north_m - self.ua.place_ned_m[0]
        return max(-15.0, min(15.0, self.options["gain_per_s"] * short_m))

    async def steer(self, north_mps: float) -> None:
        with suppress(CommandFailed):
            await self.ua.velocity(north_mps, 0.0)


def score(run: Run) -> dict[str, float]:
    """The share of UA 0's packets that the relay heard, times that of its own at the station; late in the flight."""
    packets = run.packets[run.packets.sim_time_s > LATE_S]
    shares = [
        (packets[(packets.tx == tx) & (packets.rx == rx)].fate == "delivered").mean()
        for tx, rx in (("0", "1"), ("1", "gcs"))
    ]
    return {"score": float(shares[0] * shares[1])}
