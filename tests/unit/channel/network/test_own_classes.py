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
from channel.draws import Draws
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.medium.reception import Packets
from channel.network.entry import EntryInstants, EntrySettings
from channel.network.network import Network
from channel.own.methods import OwnModelError
from channel.presets import radio_from_mapping
from channel.routing.routed import RoutingCounts
from channel.routing.router import Forwarding, Hop, HopRouter, Notice
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


def is_between(medium: Faulty, packet: AirPacket) -> None:
    at(medium, packet, medium.agenda.now_ns + 0.5)


def transmits(medium: Faulty, packet: AirPacket) -> None:
    medium._transmit(packet, lambda: None)


class Hasty(Faulty):  # a class
    """Transmits twice from the agenda, where no line of its own is on the way."""

    does = staticmethod(overlaps)


class Misled(HopRouter):
    """Gives what it is told to give, to a packet and of notices, and raises what is an error."""

    given: Any = ()
    noted: Any = None
    takes: Any = 0

    def header_bytes(self, hop: Hop) -> int:  # of header_bytes
        found: int = self.takes
        return found

    def send(self, node: int, packet: AirPacket) -> Any:  # of send
        if isinstance(self.given, Exception):
            raise self.given  # raises what it has
        return self.given

    def first_notice_ns(self, node: int) -> int | None:
        return None if self.noted is None else 5

    def notices(self, node: int, now_ns: int) -> Any:  # of notices
        return self.noted


def line(text: str) -> str:
    """Where this file has a text first, as errors tell it."""
    [number, *_] = [number for number, each in enumerate(LINES, 1) if text in each]
    return re.escape(f"{__file__}:{number}: ")


def lives(does: Any, router: HopRouter | None = None) -> RoutingCounts | None:
    """Let a network live on a medium that does so, or is of such a class."""
    config, settings = radio_from_mapping(RADIO), Serial()
    medium = Medium(Radio(config), seed=7, nodes=NODES)
    for number, node in enumerate(NODES):
        medium.place(node, (50.0 * number, 0.0, -100.0))

    def opened(world: Any) -> Faulty:
        around = Surroundings.of(world, medium.index, 7, config, medium.radios[0].noise_floor_dbm)
        limits, hearing = settings.queue.limits, settings.hearing(around)
        made = (
            does
            if isinstance(does, type)
            else type("Mine", (Faulty,), {"does": staticmethod(does), "__module__": __name__})
        )
        found: Faulty = made(around.world, settings.timings(around), limits, hearing)
        return found

    entry = EntryInstants(NODES, EntrySettings(phase_s=0.0), 50 * MS, medium.draws.common)
    network = Network(medium, opened, entry, router=router)
    network.send(Packets(*(np.array([one]) for one in (0, 1, 0, 40, 0))), [PLAIN])
    for until_ns in (200 * MS, 400 * MS, S):
        network.live(until_ns)
    return network.routing


STILL = r"node b is to transmit at \d+ ns, and its radio is on the air still: "


@pytest.mark.parametrize(
    ("does", "told"),
    [
        (overlaps, f"ValueError: {STILL}"),
        (follows, line("# from within the callback") + f"ValueError: {STILL}"),
        (raises, line("# raises itself") + "ZeroDivisionError: mine$"),
        (is_between, line("# enters the agenda") + r"ValueError: an event at 0\.5 ns: instants are whole$"),
        (goes_back, line("# enters the agenda") + "ValueError: an event at -5 ns: it is 0 ns already$"),
    ],
)
def test_what_a_medium_does_that_cannot_be_is_told(
    does: Callable[[Faulty, AirPacket], object], told: str
) -> None:
    with pytest.raises(OwnModelError, match=rf"^the medium Mine: {told}"):
        lives(does)


def test_of_what_went_through_no_line_of_a_class_that_class_is_told() -> None:
    with pytest.raises(OwnModelError, match=f"^the medium Hasty: {line('# a class')}ValueError: {STILL}"):
        lives(Hasty)


def misled(**gives: Any) -> Misled:
    router = Misled(NODES, Draws(7), Forwarding())
    for name, value in gives.items():
        setattr(router, name, value)
    return router


@pytest.mark.parametrize(
    "given",
    [
        None,
        "no_route",
        Hop(0),
        [0],
        [Hop(1)],
        [Hop(3)],
        [Hop(None, 1e6)],  # type: ignore[arg-type]
        [Hop(None, -1)],
    ],
)
def test_what_no_router_may_give_is_told_with_where_it_is_written(given: Any) -> None:
    told = line("# of send") + re.escape(f"send gave {given!r}: has to give Hops in a list, each to None or ")
    with pytest.raises(OwnModelError, match=f"^the router Misled: {told}"):
        lives(transmits, misled(given=given))


@pytest.mark.parametrize(
    ("noted", "allowed"),
    [
        (([Notice("x", -10)], 100), "Notices in a list"),
        (([Notice("x", 10.5)], 100), "Notices in a list"),  # type: ignore[arg-type]
        ((Notice("x", 10), 100), "Notices in a list"),
        (([], 5), "Notices, and an instant in whole ns after 5"),
        (([], 1e8), "Notices, and an instant in whole ns after 5"),
        ([], "Notices, and an instant in whole ns after 5"),
    ],
)
def test_notices_that_cannot_be_are_told_likewise(noted: Any, allowed: str) -> None:
    given = noted[0] if allowed == "Notices in a list" else noted
    told = line("# of notices") + re.escape(f"notices gave {given!r}: has to give {allowed}")
    with pytest.raises(OwnModelError, match=f"^the router Misled: {told}"):
        lives(transmits, misled(noted=noted))


def test_a_router_that_raises_or_has_headers_of_less_than_nothing_is_told() -> None:
    with pytest.raises(OwnModelError, match=f"^the router Misled: {line('# raises what')}KeyError: 'mine'$"):
        lives(transmits, misled(given=KeyError("mine")))
    told = line("# of header_bytes") + "header_bytes gave -1: has to give a whole number of 0 or more$"
    with pytest.raises(OwnModelError, match=f"^the router Misled: {told}"):
        lives(transmits, misled(given=[Hop(0)], takes=-1))


def test_integers_of_numpy_are_as_good_as_python_s() -> None:
    hop = Hop(np.int64(0), np.int64(100 * MS))  # type: ignore[arg-type]
    notice = Notice("x", np.int64(10))  # type: ignore[arg-type]
    counts = lives(transmits, misled(given=[hop], noted=([notice], np.int64(2 * S))))
    assert counts is not None
    assert (counts.sent, type(counts.packet_air_ns)) == (1, int)
    assert (counts.notice_bytes, type(counts.notice_bytes)) == (30, int)
