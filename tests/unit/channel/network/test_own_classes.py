"""What media and routers of a user's own do that cannot be is told by their class, file and line."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from channel.access.agenda import ACTS
from channel.access.media.plain import PlainMedium
from channel.access.packets import PLAIN, AirPacket
from channel.access.settings.base import Serial, Surroundings
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.medium.reception import Packets
from channel.network.entry import EntryInstants, EntrySettings
from channel.network.network import Network
from channel.own_methods import OwnModelError
from channel.presets import radio_from_mapping
from channel.routing.router import HopRouter
from tests.unit.channel.network.test_band import MS, RADIO, S

NODES = ("a", "b", "c")
LINES = Path(__file__).read_text(encoding="utf-8").splitlines()


class Faulty(PlainMedium):
    """Does with each packet what it is told to do."""

    does: Callable[[Faulty, AirPacket], object]

    def _wake(self, node: int) -> None:
        packet = self._next(node)
        if packet is not None:
            type(self).does(self, packet)


def at(medium: Faulty, packet: AirPacket, at_ns: Any) -> None:
    medium.agenda.at(at_ns, ACTS, packet.node, medium._transmit, packet, lambda: None)  # enters the agenda


def overlaps(medium: Faulty, packet: AirPacket) -> None:
    medium._transmit(packet, lambda: None)
    at(medium, packet, medium.agenda.now_ns + 1)


def follows(medium: Faulty, packet: AirPacket) -> None:
    medium._transmit(packet, lambda: medium._transmit(packet, lambda: None))  # from within the callback


def raises(medium: Faulty, packet: AirPacket) -> None:
    raise ZeroDivisionError("mine")  # raises itself


def goes_back(medium: Faulty, packet: AirPacket) -> None:
    at(medium, packet, medium.agenda.now_ns - 5)


def line(text: str) -> str:
    """Where this file has a text first, as errors tell it."""
    [number, *_] = [number for number, each in enumerate(LINES, 1) if text in each]
    return re.escape(f"{__file__}:{number}: ")


def lives(does: Callable[[Faulty, AirPacket], object], router: HopRouter | None = None) -> None:
    config, settings = radio_from_mapping(RADIO), Serial()
    medium = Medium(Radio(config), seed=7, nodes=NODES)
    for number, node in enumerate(NODES):
        medium.place(node, (50.0 * number, 0.0, -100.0))

    def opened(world: Any) -> Faulty:
        around = Surroundings.of(world, medium.index, 7, config, medium.radios[0].noise_floor_dbm)
        limits, hearing = settings.queue.limits, settings.hearing(around)
        made = type("Mine", (Faulty,), {"does": staticmethod(does), "__module__": __name__})
        found: Faulty = made(around.world, settings.timings(around), limits, hearing)
        return found

    entry = EntryInstants(NODES, EntrySettings(phase_s=0.0), 50 * MS, medium.draws.common)
    network = Network(medium, opened, entry, router=router)
    network.send(Packets(*(np.array([one]) for one in (0, 1, 0, 40, 0))), [PLAIN])
    for until_ns in (200 * MS, 400 * MS, S):
        network.live(until_ns)


STILL = r"node b is to transmit at \d+ ns, and its radio is on the air still: "


@pytest.mark.parametrize(
    ("does", "told"),
    [
        (overlaps, f"ValueError: {STILL}"),
        (follows, line("# from within the callback") + f"ValueError: {STILL}"),
        (raises, line("# raises itself") + "ZeroDivisionError: mine$"),
        (goes_back, line("# enters the agenda") + "ValueError: an event at -5 ns: it is 0 ns already$"),
    ],
)
def test_what_a_medium_does_that_cannot_be_is_told(
    does: Callable[[Faulty, AirPacket], object], told: str
) -> None:
    with pytest.raises(OwnModelError, match=rf"^the medium Mine: {told}"):
        lives(does)
