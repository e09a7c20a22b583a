"""Packets over chains of nodes: what is on the air when, by arithmetic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import pytest

from channel.access.media.airtime import AirTime
from channel.access.media.csma import Csma
from channel.access.media.medium import AccessMedium
from channel.access.media.schedule import Schedule, Slot
from channel.access.media.tdma import Tdma
from channel.access.packets import AirFate, AirPacket, Loss
from channel.access.queue import QueueLimits
from channel.access.timing import BitRate, wifi_g
from channel.access.world import PlainWorld
from channel.draws import Draws
from channel.own.methods import OwnModelError
from channel.routing.flood import Flood
from channel.routing.routed import Routed
from channel.routing.router import Forwarding, HopRouter, Notice
from channel.routing.static import Static

BIT_RATE = BitRate(64e3)
long = partial(pytest.param, marks=pytest.mark.long)
LENGTH_BYTES = 100
FRAME_NS = 12_500_000
"""100 bytes at 64 kb/s."""


def chain(nodes: int, reach: int = 1) -> PlainWorld:
    """Nodes in a row, each of which hears those up to ``reach`` places away."""
    deaf = [(a, b) for a in range(nodes) for b in range(nodes) if abs(a - b) > reach]
    return PlainWorld(range(nodes), deaf=deaf)


def along(nodes: int) -> Mapping[int, Mapping[int, int]]:
    """The routes from node to node along a row."""
    return {
        node: {to: node + (1 if to > node else -1) for to in range(nodes) if to != node}
        for node in range(nodes)
    }


def static(nodes: int, forwarding: Forwarding | None = None, header_bytes: int = 0) -> HopRouter:
    return Static(names(nodes), Draws(1), forwarding or Forwarding(), along(nodes), header_bytes)


def flood(nodes: int, hop_limit: int, forwarding: Forwarding | None = None) -> HopRouter:
    return Flood(names(nodes), Draws(1), forwarding or Forwarding(), hop_limit, 0)


def names(nodes: int) -> Sequence[str]:
    return [str(node) for node in range(nodes)]


def fates(network: Routed, until_ns: int) -> list[AirFate]:
    return [each for each in network.live(until_ns) if isinstance(each, AirFate)]


def packet(to: int | None, number: int = 0, at_ns: int = 0, node: int = 0) -> AirPacket:
    return AirPacket(node, number, to, LENGTH_BYTES, at_ns)


def test_each_hop_takes_its_air_time_and_the_node_its_own() -> None:
    """Three hops of 108 bytes, 13.5 ms each, and 2 ms at each of two nodes."""
    network = Routed(AirTime(chain(4), BIT_RATE), static(4, Forwarding(2_000_000), header_bytes=8))
    network.offer(packet(3))
    [fate] = fates(network, 10**9)
    assert (fate.loss, fate.at_ns, fate.attempts) == (None, 3 * 13_500_000 + 2 * 2_000_000, 3)
    assert fate.way == (0, 1, 2)
    assert (fate.started_ns, fate.ended_ns) == (31_000_000, 44_500_000)
    assert (fate.packet, fate.receiver) == (packet(3), 3)
    assert (network.counts.sent, network.counts.handed_on) == (1, 2)


def test_a_flood_comes_to_all_within_its_hops_and_once_to_each() -> None:
    """In a row of six the third hop is the last: nodes 1 to 3 have it, 4 and 5 do not."""
    network = Routed(AirTime(chain(6), BIT_RATE), flood(6, hop_limit=3))
    network.offer(packet(None))
    found = {each.receiver: each for each in fates(network, 10**9)}
    assert {node: each.at_ns for node, each in found.items() if each.loss is None} == {
        1: FRAME_NS,
        2: 2 * FRAME_NS,
        3: 3 * FRAME_NS,
    }
    assert {node: each.way for node, each in found.items() if each.loss is None} == {
        1: (0,),
        2: (0, 1),
        3: (0, 1, 2),
    }
    assert {found[4].loss, found[5].loss} == {Loss.NOISE}
    assert network.counts.duplicates == 2  # node 0 hears 1, and 1 hears 2


def in_a_row(medium: AccessMedium, router: HopRouter) -> Routed:
    """A network whose nodes stand 100 m apart."""
    return Routed(
        medium,
        router,
        lambda frame, node: 100.0 * abs(frame.node - node),
        lambda node, other, _at_ns: 100.0 * abs(node - other),
    )


@pytest.mark.parametrize("to", [None, 5])
def test_what_was_handed_on_as_often_as_it_may_be_is_lost_by_that_to_those_beyond(to: int | None) -> None:
    """In a row of six, four transmissions bring it to node 4, which would have been nearest to 5."""
    network = in_a_row(AirTime(chain(6), BIT_RATE), flood(6, hop_limit=4))
    network.offer(packet(to))
    fate = {each.receiver: each for each in fates(network, 10**9)}[5]
    assert (fate.loss, fate.attempts, fate.way) == (Loss.HOP_LIMIT, 4, (0, 1, 2, 3))
    assert (fate.started_ns, fate.ended_ns, fate.met_at) == (3 * FRAME_NS, 4 * FRAME_NS, 4)


def test_the_cause_is_of_the_hop_limit_only_where_no_transmission_was_as_near() -> None:
    """Node 0 does not hear 1, its neighbour; 2 and 3 have it and may not hand it on, but are farther from 0."""
    network = in_a_row(AirTime(PlainWorld(range(4), deaf=[(1, 0)]), BIT_RATE), flood(4, hop_limit=1))
    network.offer(packet(None, node=1))
    found = {each.receiver: each.loss for each in fates(network, 10**9)}
    assert found == {0: Loss.NOISE, 2: None, 3: None}


def test_of_a_flood_for_one_node_only_that_one_has_a_fate() -> None:
    network = Routed(AirTime(chain(5), BIT_RATE), flood(5, hop_limit=10))
    network.offer(packet(3))
    [fate] = fates(network, 10**9)
    assert (fate.receiver, fate.loss, fate.at_ns, fate.way) == (3, None, 3 * FRAME_NS, (0, 1, 2))
    assert network.counts.handed_on == 2  # node 3 does not hand it on: 4 never hears it


def test_two_who_heard_it_together_collide_without_jitter_and_not_with_it() -> None:
    """A diamond: 1 and 2 hear 0, and 3 hears both."""
    deaf = [(0, 3), (3, 0), (1, 2), (2, 1)]

    def fate_at_3(spread_ns: int) -> Loss | None:
        router = flood(4, 3, Forwarding(0, spread_ns))
        network = Routed(AirTime(PlainWorld(range(4), deaf=deaf), BIT_RATE), router)
        network.offer(packet(None))
        [fate] = [each for each in fates(network, 10**9) if each.receiver == 3]
        return fate.loss

    assert fate_at_3(0) is Loss.COLLIDED
    assert fate_at_3(10 * FRAME_NS) is None


def test_a_packet_that_a_hop_loses_is_lost_there_by_its_cause() -> None:
    """The second hop is too long for its queue: 1 sends to 2 what is larger than it may keep."""
    limits = QueueLimits(packets=1)
    network = Routed(AirTime(chain(3), BIT_RATE, limits), static(3))
    for number in range(3):  # node 1 sends its own first; the one of node 0 and two more find its queue full
        network.offer(packet(2, number, at_ns=FRAME_NS - 1, node=1))
    network.offer(packet(2))
    found = {(each.packet.node, each.packet.number): each for each in fates(network, 10**9)}
    lost = found[0, 0]
    assert (lost.loss, lost.receiver, lost.started_ns) == (Loss.HALF_DUPLEX, 2, 0)
    assert lost.met_at == 1
    assert [found[1, number].loss for number in range(3)] == [None, None, Loss.QUEUE_FULL]


def test_life_times_go_on_from_hop_to_hop() -> None:
    """20 ms: on the air at once, and gone when node 2 has had it for the second time, after 25 ms."""

    def loss(lifetime_ns: int) -> Loss | None:
        network = Routed(AirTime(chain(4), BIT_RATE), static(4, Forwarding(1_000_000)))
        network.offer(AirPacket(0, 0, 3, LENGTH_BYTES, 0, lifetime_ns=lifetime_ns))
        [fate] = fates(network, 10**9)
        return fate.loss

    assert loss(20_000_000) is Loss.EXPIRED  # at node 2 it would start after 27 ms
    assert loss(27_000_000) is None


@pytest.mark.parametrize(("later_ns", "is_refused"), [(0, True), (-5, True), (1, False)])
def test_a_router_is_asked_again_for_notices_at_a_later_instant(later_ns: int, is_refused: bool) -> None:
    """Else it would be asked at one instant for ever."""

    class Again(HopRouter):
        def first_notice_ns(self, node: int) -> int | None:
            return 1000 if node == 1 else None

        def notices(self, node: int, now_ns: int) -> tuple[Sequence[Notice], int]:
            return [], now_ns + later_ns

    network = Routed(AirTime(chain(2), BIT_RATE), Again(names(2), Draws(1), Forwarding()))
    if not is_refused:
        assert network.live(2000) == []
        return
    told = (
        rf"router Again: .*: notices gave \(\[\], {1000 + later_ns}\): .* an instant in whole ns after 1000"
    )
    with pytest.raises(OwnModelError, match=told):
        network.live(2000)


def rate(medium: AccessMedium, nodes: int, period_ns: int, until_ns: int) -> float:
    """Packets a second that come to the last node of a row in the second half of a time, offered at its first."""
    network = Routed(medium, static(nodes))
    for number in range(until_ns // period_ns):
        network.offer(packet(nodes - 1, number, at_ns=number * period_ns))
    came = [each for each in fates(network, until_ns) if each.loss is None]
    half_ns = until_ns // 2
    return sum(each.at_ns > half_ns for each in came) / ((until_ns - half_ns) / 1e9)


def slots(groups: Sequence[Sequence[int]]) -> Schedule[int]:
    """Slots of one frame each, one after the other; nodes of one group transmit together."""
    starts = range(0, len(groups) * FRAME_NS, FRAME_NS)
    each = [
        Slot(start_ns=start_ns, duration_ns=FRAME_NS, guard_ns=0, nodes=tuple(group))
        for start_ns, group in zip(starts, groups, strict=True)
    ]
    return Schedule(tuple(each), len(groups) * FRAME_NS)


@pytest.mark.parametrize("hops", [1, long(2), long(3), long(4), 5])
def test_a_chain_of_half_duplex_hops_carries_one_share_of_each(hops: int) -> None:
    """Slots by turns: 80 frames a second, divided by the hops."""
    medium = Tdma(chain(hops + 1), BIT_RATE, slots([[node] for node in range(hops)]))
    assert rate(medium, hops + 1, FRAME_NS, 40 * 10**9) == pytest.approx(80.0 / hops, rel=0.05)


@pytest.mark.parametrize("hops", [long(4), long(5), 6])
def test_with_spatial_reuse_a_long_chain_carries_a_third(hops: int) -> None:
    """Every third node transmits at once: none of their receivers hears two of them."""
    groups = [[node for node in range(hops) if node % 3 == turn] for turn in range(3)]
    medium = Tdma(chain(hops + 1), BIT_RATE, slots(groups))
    assert rate(medium, hops + 1, FRAME_NS, 40 * 10**9) == pytest.approx(80.0 / 3, rel=0.05)


@pytest.mark.parametrize("seed", range(1, 30))
def test_an_older_packet_does_not_take_the_place_of_a_newer_one_at_a_relay(seed: int) -> None:
    """A flood holds packets back by up to 20 ms, so that the older one may come last to a radio that is busy."""
    router = Flood(names(3), Draws(seed), Forwarding(1_000_000, 20_000_000), 2, 0)
    network = Routed(AirTime(chain(3), BitRate(200e3)), router)
    for number, at_ns in ((1, 0), (2, 5_000_000)):
        network.offer(AirPacket(0, number, None, 50, at_ns, key="state"))
    network.offer(AirPacket(1, 0, 2, 2000, 9_000_000))
    came = {(each.packet.number, each.receiver) for each in fates(network, 10**9) if each.loss is None}
    assert (2, 2) in came or (2, 1) not in came


def test_air_time_has_what_was_tried_again_though_it_had_come() -> None:
    """Of two stations the second hears the first, who hears no acknowledgement: seven frames of 802.11g at 6 Mb/s.

    100 + 36 bytes are 47 symbols of 4 us; 20 us before, 6 after.
    """
    network = Routed(Csma(PlainWorld(range(2), deaf=[(1, 0)]), wifi_g()), static(2))
    network.offer(packet(1))
    [fate] = fates(network, 10**9)
    assert (fate.loss, fate.attempts) == (None, 1)
    assert (network.counts.sent, network.counts.packet_air_ns) == (1, 7 * (20 + 47 * 4 + 6) * 1000)
