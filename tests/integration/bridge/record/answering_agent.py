"""An agent of the tests of reflights: what it hears decides what it transmits, records and does."""

from __future__ import annotations

from collections import Counter

from lostlink import Agent, Reception


class Answering(Agent):
    """Answers each packet, changes its aircraft's mode at the first, and is done once it heard enough of each sender.

    Its option `enough` has how many, by sender; without it, it is never done.
    """

    async def fly(self) -> None:
        self.heard: Counter[str] = Counter()
        await self.ua.wait_for(lambda _: self.heard.total() > 0)
        await self.ua.set_mode("GUIDED")
        enough = Counter(self.options.get("enough", {"nobody": 1}))
        await self.ua.wait_for(lambda _: self.heard >= enough)

    def on_packet(self, sender: str, channel: str, payload: bytes, reception: Reception) -> None:
        self.heard[sender] += 1
        self.log("heard", reception.seq)
        self.ua.transmit("answer", payload[:50], to=sender, radio=reception.radio)
