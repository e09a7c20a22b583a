"""Packets passed on by a node in the middle.

lostlink run examples/agents/relay.yaml

agents/0/heard.jsonl in the run directory has what UA 0 heard of UA 2, by way of UA 1, and how long it took.
"""

from __future__ import annotations

from lostlink import Agent


class Talker(Agent):
    """Says its sim time five times a second, and records what the others say. Options: altitude_m, hold_s."""

    async def fly(self) -> None:
        await self.take_off(self.options["altitude_m"])
        begin_s = self.ua.sim_time_ns / 1e9
        async for now_s in self.every(0.2):
            self.ua.transmit("talk", f"{self.ua.node} {self.ua.sim_time_ns}".encode())
            if now_s - begin_s >= self.options["hold_s"]:
                break

    def on_packet(self, sender, channel, payload, reception):
        super().on_packet(sender, channel, payload, reception)
        if channel == "relayed":
            origin, sent_ns = payload.decode().split()
            if origin != self.ua.node:
                self.record("heard", origin=origin, by=sender, delay_ns=self.ua.sim_time_ns - int(sent_ns))


class Relay(Agent):
    """Passes on all talk that it hears, and holds its place until nobody talks any more."""

    async def fly(self) -> None:
        self.passed = 0
        await self.take_off(self.options["altitude_m"])
        await self.sleep(self.options["hold_s"])
        self.ua.report(f"passed {self.passed} packets on")

    def on_packet(self, sender, channel, payload, reception):
        super().on_packet(sender, channel, payload, reception)
        if channel == "talk":
            self.passed += 1
            self.ua.transmit("relayed", payload)
