"""An agent of the tests of reflights: what it hears decides what it transmits, records and does."""

from __future__ import annotations

from lostlink import Agent, Reception


class Answering(Agent):
    """Answers each packet, and changes its aircraft's mode at the first."""

    async def fly(self) -> None:
        self.heard = 0
        await self.ua.wait_for(lambda _: self.heard > 0)
        await self.ua.set_mode("GUIDED")
        await self.sleep_until(1e6)

    def on_packet(self, sender: str, channel: str, payload: bytes, reception: Reception) -> None:
        self.heard += 1
        self.log("heard", reception.seq)
        self.ua.transmit("answer", payload[:50], to=sender, radio=reception.radio)
