"""An agent that asks a program outside what to do, and waits for its answer: sim time stands still meanwhile."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from math import nan
from multiprocessing.connection import Client

from lostlink import Agent, CommandFailed, Reception


class Steered(Agent):
    """Options: address (of the program's `Listener`), height_m, period_s."""

    async def fly(self) -> None:
        self.heard: list[float] = []
        with Client(self.options["address"]) as program:
            await self.take_off(self.options["height_m"])
            async for now_s in self.every(self.options["period_s"]):
                program.send(self.observation(now_s))
                north_mps = program.recv()  # blocks: the tick is not over before the answer is there
                if north_mps is None:
                    break
                self.steering = asyncio.create_task(self.steer(north_mps))
                await asyncio.sleep(0)

    def observation(self, now_s: float) -> dict[str, float]:
        """What it knows, and no more: the program has no other eyes."""
        heard, self.heard = self.heard, []
        return {
            "now_s": now_s,
            "north_m": self.ua.place_ned_m[0],
            "heard": len(heard),
            "rssi_dbm": sum(heard) / len(heard) if heard else nan,
        }

    async def steer(self, north_mps: float) -> None:
        with suppress(CommandFailed):
            await self.ua.velocity(north_mps, 0.0)

    def on_packet(self, sender: str, channel: str, payload: bytes, reception: Reception) -> None:
        super().on_packet(sender, channel, payload, reception)
        self.heard.append(reception.rssi_dbm)
