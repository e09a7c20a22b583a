"""Agents of the tests of media: one that sends what its options list, and keeps what it hears."""

from __future__ import annotations

from lostlink import Agent, Reception


class Scripted(Agent):
    """Sends what ``sends`` lists: (at_s, to, bytes), perhaps (priority, lifetime_s, key, radio).

    Then ``count`` packets of ``size`` bytes each ``period_s``.
    """

    async def fly(self) -> None:
        self.heard: list[tuple[str, int]] = []
        for name, radio in self.ua.radios.items():
            radio.on_reply(lambda reply, name=name: self.record("replies", radio=name, **reply._asdict()))
        for at_s, to, size, *more in self.options.get("sends", []):
            await self.sleep_until(at_s)
            number = self.ua.sent
            handling = dict(zip(("priority", "lifetime_s", "key", "radio"), more, strict=False))
            self.ua.transmit("test", number.to_bytes(4, "little") + bytes(size - 4), to=to, **handling)
        period_s = self.options.get("period_s")
        if period_s:
            async for _ in self.every(period_s):
                for _ in range(self.options.get("count", 1)):
                    size = self.options.get("size", 100)
                    self.ua.transmit("test", bytes(size), to=self.options.get("to", "all"))
        await self.sleep_until(1e6)

    def on_tick(self, sim_time_ns: int) -> None:
        for name, radio in self.ua.radios.items():
            self.record("queue" if name == "main" else f"queue-{name}", **radio.queue._asdict())

    def on_packet(self, sender: str, channel: str, payload: bytes, reception: Reception) -> None:
        self.record(
            "heard",
            sender=sender,
            radio=reception.radio,
            seq=reception.seq,
            sent_ns=reception.sim_time_ns,
            received_ns=reception.received_ns,
            delay_s=reception.delay_s,
            **reception.instants._asdict(),
        )
