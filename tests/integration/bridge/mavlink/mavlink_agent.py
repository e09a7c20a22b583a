"""An agent of the tests that sends MAVLink frames as packets, all at one tick."""

from __future__ import annotations

from lostlink import Agent


class Frames(Agent):
    """Options: at_s, frames: in hex, in the order of sending."""

    async def fly(self) -> None:
        await self.sleep_until(self.options["at_s"])
        for frame in self.options["frames"]:
            self.ua.transmit("mavlink", bytes.fromhex(frame), to="0")
        await self.sleep_until(1e6)
