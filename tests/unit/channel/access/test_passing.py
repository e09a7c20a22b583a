"""A frame that passes receivers as a whole leaves what it would leave by one event after the other."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from channel.access.air import Hearing
from channel.access.media.airtime import AirTime
from channel.access.media.csma import Csma
from channel.access.media.forecast import Forecast
from channel.access.media.medium import AccessMedium
from channel.access.media.schedule import Schedule, Slot
from channel.access.media.tdma import Tdma
from channel.access.packets import AirFate, AirFates, AirFrame, AirPacket, Loss
from channel.access.queue import QueueLimits
from channel.access.timing import BitRate, wifi_g
from channel.access.world import Arrival, PlainWorld, World
from channel.link.radio import Radio
from channel.network.radio_world import RadioWorld
from channel.presets import load_radio

S, US = 1_000_000_000, 1_000
NODES = 12


class OneByOne:
    """A world of which nothing can pass as a whole: it gives no columns."""

    def __init__(self, world: World) -> None:
        self.nodes, self._world = world.nodes, world
        self.survives, self.comes_alone = world.survives, world.comes_alone

    def reach(self, frame: AirFrame) -> Sequence[Arrival]:
        return list(self._world.reach(frame))


def near() -> World:
    return PlainWorld(range(NODES), delay_ns=700, loss=0.1)


def at_once() -> World:
    return PlainWorld(range(NODES), loss=0.1)


def hidden() -> World:
    deaf = [(a, b) for a in range(NODES) for b in range(NODES) if (a + b) % 5 == 0]
    powers = {(a, b): 10.0 ** (-13.0 + (a * b) % 4) for a in range(NODES) for b in range(NODES)}
    return PlainWorld(range(NODES), delay_ns=20_000, loss=0.1, deaf=deaf, power_mw=powers)


def far() -> World:
    places = {node: (700.0 * (node % 4), 900.0 * (node // 4), -50.0 - node) for node in range(NODES)}
    return RadioWorld(Radio(load_radio("wifi-2.4")), places)


def medium_of(name: str, world: World) -> AccessMedium:
    if name == "csma":
        return Csma(world, wifi_g(), limits=QueueLimits(4), hearing=Hearing(1e-12, 1e-11, cca_ns=4_000))
    if name == "no cca":
        return Csma(world, wifi_g(), hearing=Hearing(1e-10, 1e-9, capture=10.0))
    if name == "airtime":
        return AirTime(world, BitRate(2e6))
    return Tdma(world, BitRate(2e6), Schedule.equal(tuple(range(NODES)), 2_000 * US, 100 * US))


def offer(medium: AccessMedium, rate_hz: float, unicasts: bool) -> None:
    rng = np.random.default_rng(7)
    for node in range(NODES):
        for number in range(int(rate_hz)):
            at_ns = int((number + rng.uniform()) * S / rate_hz)
            to = (node + 1 + number % 3) % NODES if unicasts and number % 4 == 0 else None
            medium.offer(AirPacket(node, number, to, 50 + 30 * (number % 5), at_ns))


@pytest.mark.parametrize(
    ("rate_hz", "unicasts"),
    [
        (10, False),
        (10, True),
        pytest.param(60, False, marks=pytest.mark.long),
        pytest.param(60, True, marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("world", [near, at_once, hidden, far])
@pytest.mark.parametrize("name", ["csma", pytest.param("no cca", marks=pytest.mark.slow), "airtime", "tdma"])
def test_passing_changes_nothing(
    name: str, world: Callable[[], World], rate_hz: float, unicasts: bool
) -> None:
    """Receivers that are followed singly by events are the oracle."""
    passing, singly = medium_of(name, world()), medium_of(name, OneByOne(world()))
    passed = 0
    for medium in (passing, singly):
        offer(medium, rate_hz, unicasts)
    for tick in range(1, 12):
        outcomes = passing.live(tick * S // 10)
        passed += sum(isinstance(outcome, AirFates) for outcome in outcomes)
        found = [
            one
            for outcome in outcomes
            for one in (outcome.singly() if isinstance(outcome, AirFates) else [outcome])
        ]
        wanted = singly.run(tick * S // 10)
        assert sorted(map(repr, found)) == sorted(map(repr, wanted))
    assert passed > 20


def test_radios_that_turn_to_other_channels_hear_one_by_one() -> None:
    """All listen on channel 0 until the first turn; then half of them are elsewhere while node 0 transmits there."""
    slots = (
        Slot((0,), 0, 4_000 * US),
        Slot((0,), 4_000 * US, 4_000 * US, listeners=tuple(range(1, 6))),
        Slot((6,), 4_000 * US, 4_000 * US, channel=1, listeners=tuple(range(7, NODES))),
    )
    passing, singly = (
        Tdma(world, BitRate(2e6), Schedule(slots, 8_000 * US)) for world in (near(), OneByOne(near()))
    )
    for medium in (passing, singly):
        offer(medium, 60, unicasts=False)
    found = passing.run(S)
    assert list(map(repr, found)) == list(map(repr, singly.run(S)))
    assert {one.loss for one in found if isinstance(one, AirFate)} >= {None, Loss.NO_LOCK}


def test_outcomes_come_in_the_order_of_their_instants() -> None:
    medium = medium_of("csma", far())
    offer(medium, 30, unicasts=True)
    outcomes = medium.run(2 * S)
    assert [one.at_ns for one in outcomes] == sorted(one.at_ns for one in outcomes)
    assert sum(isinstance(one, AirFate) for one in outcomes) > 100


def frame_of(node: int, started_ns: int) -> AirFrame:
    return AirFrame(node, 0, "data", 100, started_ns, started_ns + 200 * US)


def test_who_finds_the_medium_busy_waits_for_its_end_difs_and_its_back_off() -> None:
    """802.11g: DIFS is 28 us, a slot 9 us; frames of 200 us, ways of 1 us."""
    entered_us = (0, 50, 120)
    frames = [frame_of(node, (entered + 28) * US) for node, entered in enumerate(entered_us)]
    delays_ns = [{other: 1 * US for other in range(3) if other != node} for node in range(3)]
    forecast = Forecast(frames, delays_ns, wifi_g(), 4 * US, lambda node: {1: 7, 2: 3}[node])
    first, second, third = forecast.frames()
    assert (first.node, first.started_ns) == (0, 28 * US)
    # node 0 is on the air from 28 to 228 us: at 229 us it is idle for nodes 1 and 2, which count from 257 us on
    assert (second.node, second.started_ns) == (2, (257 + 3 * 9) * US)
    # node 2 starts at 284 us: node 1 senses it at 289 us, when 3 of its 7 slots are over, and counts on from 513 us
    assert (third.node, third.started_ns) == (1, (284 + 200 + 1 + 28 + 4 * 9) * US)
    assert third.ended_ns - third.started_ns == 200 * US
