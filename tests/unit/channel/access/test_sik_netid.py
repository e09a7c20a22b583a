"""More than two SiK radios on one NETID, against arithmetic for windows that coincide and a reckoning tick by tick."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest

from channel.access.air import Hearing
from channel.access.media.sik.medium import Sik
from channel.access.media.sik.stream import Passage
from channel.access.media.sik.timing import NOMINAL_TICK_NS, SikSettings
from channel.access.packets import AirFate, AirPacket, Loss
from channel.access.queue import QueueLimits
from channel.access.world import PlainWorld
from tests.unit.channel.access.netid_reckoning import LOOK_TICKS, TICK_US, reckoned

S = 1_000_000_000
UNLIMITED = QueueLimits(0)
BOTH_BUSY, ONE_BUSY = 3240, 6345
"""Bytes a second of a pair at 64 kb/s (the table of `test_sik`): of own windows, and of both."""
PACKET_BYTES = 50
LOCK_S = 20


def netid(count: int, **settings: object) -> SikSettings:
    """All on one NETID, a stream of bytes, in step from the start of the first one's window on."""
    return SikSettings(networks=(tuple(range(count)),), framing=False, phases=((0, -1),), **settings)  # type: ignore[arg-type]


def fates_of_busy(medium: Sik, nodes: Sequence[int], seconds: int) -> list[AirFate]:
    """Give nodes more than fits, and live."""
    for node in nodes:
        for number in range(7000 * seconds // PACKET_BYTES):
            medium.offer(AirPacket(node, number, None, PACKET_BYTES, 0))
    return [one for one in medium.run(seconds * S) if isinstance(one, AirFate)]


def bytes_a_second(found: Sequence[AirFate], tx: int, rx: int, seconds: int) -> float:
    came = [one for one in found if (one.packet.node, one.receiver, one.loss) == (tx, rx, None)]
    return len(came) * PACKET_BYTES / seconds


def test_of_three_that_are_busy_the_one_whose_window_is_its_own_gets_through() -> None:
    """Windows of 1 and 2 coincide: equal frames meet to the end, at 0 as strong as each other, and neither is heard."""
    medium = Sik(PlainWorld(range(3)), netid(3), limits=UNLIMITED)
    found = fates_of_busy(medium, [0, 1, 2], LOCK_S)
    for rx in (1, 2):
        assert bytes_a_second(found, 0, rx, LOCK_S) == pytest.approx(BOTH_BUSY, rel=0.01)
    losses = Counter((one.packet.node, one.receiver, one.loss) for one in found if one.packet.node)
    assert set(losses) == {
        (1, 0, Loss.COLLIDED),
        (2, 0, Loss.COLLIDED),
        (1, 2, Loss.HALF_DUPLEX),
        (2, 1, Loss.HALF_DUPLEX),
    }


def test_who_hears_only_collisions_loses_its_lock_and_goes_on_to_be_heard() -> None:
    """After 41 looks without a packet node 0 listens on one channel; 1 and 2 follow it all the same."""
    medium = Sik(PlainWorld(range(3)), netid(3), limits=UNLIMITED)
    found = fates_of_busy(medium, [0, 1, 2], 40)
    assert [medium.is_locked(node) for node in range(3)] == [False, True, True]
    assert bytes_a_second(found, 0, 1, 40) == pytest.approx(BOTH_BUSY, rel=0.01)
    lost_ns = min(one.at_ns for one in found if one.loss is Loss.NO_LOCK)
    assert 40 * 0.5136 <= lost_ns / S <= 42 * 0.5136 + 0.3


@pytest.mark.parametrize("seed", range(3))
def test_one_talks_and_two_have_nothing_to_say(seed: int) -> None:
    """Empty packets of 1 and 2 meet at 0, so their window is not given to it, but after statistics of one of them."""
    medium = Sik(PlainWorld(range(3)), netid(3), seed=seed, limits=UNLIMITED)
    found = fates_of_busy(medium, [0], 30)
    for rx in (1, 2):
        assert 0.99 * BOTH_BUSY <= bytes_a_second(found, 0, rx, 30) <= 0.8 * ONE_BUSY
    pair = Sik(PlainWorld(range(2)), netid(2), seed=seed, limits=UNLIMITED)
    alone = bytes_a_second(fates_of_busy(pair, [0], 30), 0, 1, 30)
    assert alone == pytest.approx(ONE_BUSY, rel=0.01)


@pytest.mark.parametrize("seed", range(3))
def test_a_radio_that_is_stronger_than_the_other_yields_its_window_all_the_same(seed: int) -> None:
    """With capture 0 hears the empty packets of 1: it sends as much as in a pair, most of which arrives."""
    power = {(tx, rx): 1e-3 if (tx, rx) == (1, 0) else 1e-5 for tx in range(3) for rx in range(3)}
    world = PlainWorld(range(3), power_mw=power, sinr_min=10.0)
    medium = Sik(world, netid(3), seed=seed, limits=UNLIMITED, hearing=Hearing(capture=10.0))
    found = fates_of_busy(medium, [0], 30)
    sent = sum(PACKET_BYTES for one in found if one.receiver == 1) / 30
    assert sent == pytest.approx(ONE_BUSY, rel=0.02)
    assert bytes_a_second(found, 0, 1, 30) > 0.75 * ONE_BUSY


CASES = [
    pytest.param((2000, 2000), 0.02, 1, marks=pytest.mark.long),
    ((1000, 1000, 1000), 0.15, 1),
    pytest.param((0, 3000, 3000), 0.05, 8, marks=pytest.mark.long),
]


@pytest.mark.slow
@pytest.mark.parametrize(("rates", "tolerance", "seeds"), CASES)
def test_shares_that_get_through(rates: tuple[int, ...], tolerance: float, seeds: int) -> None:
    """Bursts of 200 B at random, on one channel without the fault: what comes of all, as a reckoning has it."""
    seconds, burst, piece = 20, 200, 10
    sums = np.zeros(2)
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        ticks = [
            np.sort(rng.integers(0, int(seconds * 1e6 / TICK_US), rate * seconds // burst)).tolist()
            for rate in rates
        ]
        looks = rng.integers(0, LOOK_TICKS, len(rates)).tolist()
        units = reckoned([[(at, burst) for at in each] for each in ticks], looks, seconds)
        settings = netid(len(rates), channels=1, uint8_fault=False, tick_ns=NOMINAL_TICK_NS)
        medium = Sik(PlainWorld(range(len(rates))), settings, seed=seed, limits=UNLIMITED)
        for node, each in enumerate(ticks):
            for number in range(len(each) * burst // piece):
                at_ns = each[number * piece // burst] * NOMINAL_TICK_NS
                medium.offer(AirPacket(node, number, None, piece, at_ns))
        found = [one for one in medium.run(seconds * S) if isinstance(one, AirFate) and one.loss is None]
        sums += piece * len(found), sum(unit.came.total() for unit in units)
    assert sums[0] == pytest.approx(sums[1], rel=tolerance)
    offered = seeds * seconds * sum(rates) * (len(rates) - 1)
    assert (sums[0] > 0.95 * offered) == (len(rates) == 2), "what is lost is lost to the third"


def test_what_is_for_all_reaches_each_of_the_netid_and_what_is_for_one_that_one() -> None:
    medium = Sik(PlainWorld(range(6)), SikSettings(networks=((0, 1, 2), (3, 4))))
    sent = [(0, None, None), (0, 2, None), (0, 3, None), (5, None, None), (0, None, frozenset({2, 3, 4}))]
    for number, (node, to, members) in enumerate(sent):
        medium.offer(AirPacket(node, number, to, 30, number * 3 * S, members=members))
    found = {
        (one.packet.number, one.receiver): one.loss for one in medium.run(20 * S) if isinstance(one, AirFate)
    }
    assert found == {
        (0, 1): None,
        (0, 2): None,
        (1, 2): None,
        (2, 3): Loss.NO_PEER,
        (4, 2): None,
    }


def test_a_packet_in_parts_is_lost_where_a_part_of_it_is() -> None:
    passage = Passage(AirPacket(0, 0, None, 1000, 0))
    decided = [
        passage.passes(receiver, length_bytes, is_lost=is_lost)
        for receiver, length_bytes, is_lost in [
            (1, 300, False),
            (2, 300, True),
            (1, 700, False),
            (2, 700, False),
        ]
    ]
    assert decided == [False, True, True, False]


def test_three_that_are_switched_on_find_each_other() -> None:
    """In a few cycles of 50 channels, 5.8 s each."""
    for seed in range(5):
        medium = Sik(PlainWorld(range(3)), SikSettings(networks=((0, 1, 2),), locked=False), seed=seed)
        medium.run(S)
        assert not all(medium.is_locked(node) for node in range(3))
        medium.run(60 * S)
        assert all(medium.is_locked(node) for node in range(3))


@pytest.mark.slow
@pytest.mark.parametrize("locked", [True, False])
def test_the_ledger_balances_however_it_is_run(locked: bool) -> None:
    rng = np.random.default_rng(1)
    instants = np.sort(rng.integers(0, 20 * S, 400)).tolist()
    packets = [
        AirPacket(int(rng.integers(6)), number, None, int(rng.integers(0, 400)), at_ns)
        for number, at_ns in enumerate(instants)
    ]

    def run(steps: Sequence[int]) -> list[AirFate]:
        settings = SikSettings(networks=((0, 1, 2, 5), (3, 4)), locked=locked)
        medium = Sik(PlainWorld(range(6), loss=0.05, delay_ns=500), settings)
        found = []
        for before_ns, until_ns in pairwise(steps):
            for packet in packets:
                if before_ns <= packet.at_ns < until_ns:
                    medium.offer(packet)
            found += [one for one in medium.run(until_ns - 1) if isinstance(one, AirFate)]
        wanted = [(packet, to) for packet in packets for to in medium.receivers_of(packet)]
        assert Counter((one.packet, one.receiver) for one in found) == Counter(wanted)
        return found

    at_once = run([0, 60 * S])
    assert run(range(0, 60 * S + 1, S // 20)) == at_once


def test_mistakes_are_said() -> None:
    with pytest.raises(ValueError, match=r"networks \(\(0, 1\), \(2,\)\): 2 or more nodes in each"):
        Sik(PlainWorld(range(3)), SikSettings(networks=((0, 1), (2,))))
    with pytest.raises(ValueError, match="at most once"):
        Sik(PlainWorld(range(3)), SikSettings(networks=((0, 1, 1),)))
