"""Agree on a meeting point over links that lose packets, and meet there.

lostlink run examples/consensus/consensus.yaml

docs/tutorial/consensus.md says what it does and what it needs.
"""

from __future__ import annotations

import math
import struct

from averaging import SCHEMES

from lostlink import Agent, DecodeError, Reception

CHANNEL = "consensus"


class Meet(Agent):
    """Options: see docs/tutorial/consensus.md."""

    message: struct.Struct | None = None
    """What is broadcast: the number of the step, and the scheme's numbers; None before the first."""

    def transmit_package(self, sim_time_ns: int) -> None:
        """No data package: the mission's packets say all."""

    async def fly(self) -> None:
        options = self.options
        await self.take_off(options["altitude_m"])
        await self.sleep_until(options["agree_s"])
        place = self.ua.place_ned_m[:2]
        self.log("proposal", place)
        self.averaging = SCHEMES[options.get("scheme", "running_sums")](place, options["nodes"])
        await self.agree()
        await self.meet(*self.averaging.estimate)

    async def agree(self) -> None:
        """Average with the others until it is time to leave."""
        number = 0
        async for now_s in self.every(self.options["period_s"]):
            told = self.averaging.step()
            self.message = struct.Struct(f"<I{len(told)}d")
            self.log("estimate", self.averaging.estimate)
            if now_s >= self.options["leave_s"]:
                return
            self.ua.transmit(CHANNEL, self.message.pack(number, *told))
            number += 1

    async def meet(self, north_m: float, east_m: float) -> None:
        """Fly to its place on the ring around the meeting point."""
        options = self.options
        bearing_rad = math.radians(options["bearing_deg"])
        north_m += options["radius_m"] * math.cos(bearing_rad)
        east_m += options["radius_m"] * math.sin(bearing_rad)
        altitude_m, speed_mps = options["altitude_m"], options["speed_mps"]
        await self.ua.goto_ned(north_m, east_m, -altitude_m, frame="fleet", speed_mps=speed_mps)

    def on_packet(self, sender: str, channel: str, payload: bytes, reception: Reception) -> None:
        super().on_packet(sender, channel, payload, reception)
        if channel != CHANNEL or self.message is None:
            return
        if len(payload) != self.message.size:
            raise DecodeError(f"{len(payload)} bytes on {CHANNEL}: the mission's have {self.message.size}")
        number, *told = self.message.unpack(payload)
        self.averaging.hear(sender, number, tuple(told))
