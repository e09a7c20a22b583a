"""Keep a UA connected that flies out of range: a relay goes where the channel model says that most gets through.

lostlink run examples/relay_placement/relay_placement.yaml

docs/tutorial/relay-placement.md says what it does and what it needs.
"""

from __future__ import annotations

import asyncio
import struct

import numpy as np
from placement import best, grid, links_of, relayed

from channel import Radio
from channel.presets import radio_from_mapping
from lostlink import Agent, DecodeError, Reception

COMMAND, REPORT = "command", "report"
"""Channels: from the ground station to the UA, and back."""
MESSAGE = struct.Struct("<Iqfff")
"""Number, sim time of transmission (ns), and where its sender was: north, east, down (m) in the fleet's frame."""


class End(Agent):
    """An end of the link: transmits numbered packets on one channel, and logs those that come on the other."""

    transmits_on, hears_on = COMMAND, REPORT

    def transmit_package(self, sim_time_ns: int) -> None:
        """No data package: the mission's packets say all."""

    def __init__(self, *args) -> None:
        super().__init__(*args)
        self.numbers_heard: set[int] = set()

    async def talk(self) -> None:
        number = 0
        async for _ in self.every(self.options["period_s"]):
            self.ua.transmit(
                self.transmits_on, MESSAGE.pack(number, self.ua.sim_time_ns, *self.place_ned_m())
            )
            self.log("sent", number)
            number += 1

    def on_packet(self, sender: str, channel: str, payload: bytes, reception: Reception) -> None:
        super().on_packet(sender, channel, payload, reception)
        if channel != self.hears_on:
            return
        number, sent_ns, *_ = unpacked(payload)
        if number not in self.numbers_heard:
            self.numbers_heard.add(number)
            self.log(
                "arrived", {"number": number, "by": sender, "age_s": (self.ua.sim_time_ns - sent_ns) / 1e9}
            )

    def place_ned_m(self) -> tuple[float, float, float]:
        """Where it is, in the fleet's frame."""
        return aircraft_ned_m(self)


class Ground(End):
    """The ground station. Options: period_s."""

    async def fly(self) -> None:
        await self.talk()

    def place_ned_m(self) -> tuple[float, float, float]:
        place = self.config.place
        return place.north_m, place.east_m, -place.height_m


class Mover(End):
    """The UA that flies away. Options: altitude_m, speed_mps, way (list of [north, east]), period_s."""

    transmits_on, hears_on = REPORT, COMMAND

    async def fly(self) -> None:
        self.talking = asyncio.create_task(self.talk())
        await self.take_off(self.options["altitude_m"])
        for north_m, east_m in self.options["way"]:
            await go_to(self, north_m, east_m)
        self.talking.cancel()


class Relay(Agent):
    """Passes on what it hears, from the best place that it knows. Options: see docs/tutorial/relay-placement.md."""

    def __init__(self, *args) -> None:
        super().__init__(*args)
        options = self.options
        self.far_end = {COMMAND: options["ua"], REPORT: options["ground"]}
        self.heard: dict[
            str, tuple[int, np.ndarray]
        ] = {}  # by channel: sim time and place of the newest sender
        self.links = links_of(*(radio_of(options, each) for each in ("ground", "ua")), MESSAGE.size)
        self.candidates = grid(**options["area"], height_m=options["altitude_m"])

    def transmit_package(self, sim_time_ns: int) -> None:
        """No data package: it transmits what it passes on."""

    async def fly(self) -> None:
        await self.take_off(self.options["altitude_m"])
        async for _ in self.every(self.options["replan_s"]):
            if self.options.get("relay", True) and len(self.heard) == len(self.far_end):
                self.plan()

    def plan(self) -> None:
        """Choose a place for where the two ends said that they are, and fly there; a newer plan takes over."""
        (_, ground), (told_ns, mover) = self.heard[COMMAND], self.heard[REPORT]
        chances = relayed(self.links, ground, mover, self.candidates)
        chosen = best(
            chances.both, self.candidates, np.array(aircraft_ned_m(self)), self.options.get("slack", 0.005)
        )
        place = self.candidates[chosen]
        self.log(
            "plan",
            {
                "north_m": place[0],
                "east_m": place[1],
                "chance": chances.both[chosen],
                "age_s": (self.ua.sim_time_ns - told_ns) / 1e9,
            },
        )
        self.flight = asyncio.create_task(go_to(self, float(place[0]), float(place[1])))

    def on_packet(self, sender: str, channel: str, payload: bytes, reception: Reception) -> None:
        super().on_packet(sender, channel, payload, reception)
        if channel not in self.far_end:
            return
        _, sent_ns, *place = unpacked(payload)
        self.heard[channel] = (sent_ns, np.array(place))
        if self.options.get("relay", True):
            self.ua.transmit(channel, payload, to=self.far_end[channel])


def unpacked(payload: bytes) -> tuple[int, int, float, float, float]:
    if len(payload) != MESSAGE.size:
        raise DecodeError(f"{len(payload)} bytes are no message of the mission, which has {MESSAGE.size}")
    return MESSAGE.unpack(payload)


def radio_of(options, who: str) -> Radio:
    """The radio that the relay believes one to have: a preset's name, or a mapping as in a scenario."""
    radio = options["radios"][who]
    return Radio(radio_from_mapping({"preset": radio} if isinstance(radio, str) else radio))


def aircraft_ned_m(agent: Agent) -> tuple[float, float, float]:
    """Where an agent's aircraft is, in the fleet's frame; before its first fix it is at home."""
    return agent.ua.place_ned_m or agent.ua.frames.home_ned_m


async def go_to(agent: Agent, north_m: float, east_m: float) -> None:
    """Fly to a place in the fleet's frame, at the altitude and speed of the options."""
    altitude_m, speed_mps = agent.options["altitude_m"], agent.options["speed_mps"]
    await agent.ua.goto_ned(north_m, east_m, -altitude_m, frame="fleet", speed_mps=speed_mps)
