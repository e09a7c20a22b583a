"""Nodes that hand packets on, over any net: each packet has one fate for each receiver, and no way goes back."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from channel.access.media.airtime import AirTime
from channel.access.media.csma import Csma
from channel.access.media.medium import AccessMedium
from channel.access.media.schedule import Schedule
from channel.access.media.tdma import Tdma
from channel.access.packets import AirFate, AirPacket, Reply
from channel.access.queue import QueueLimits
from channel.access.timing import BitRate, wifi_g
from channel.access.world import PlainWorld
from channel.draws import Draws
from channel.routing.flood import Flood
from channel.routing.mesh.mesh import Mesh, MeshNumbers
from channel.routing.routed import Routed
from channel.routing.router import Forwarding, HopRouter
from channel.routing.static import Static, leads_back

NODES = range(5)
END_NS = 30 * 10**9
LINKS = [(a, b) for a in NODES for b in NODES if a != b]
RATE = BitRate(200e3)
SENT_FROM_NS, SENT_TO_NS = 4 * 10**9, 8 * 10**9


def media(name: str, world: PlainWorld, seed: int) -> AccessMedium:
    limits = QueueLimits(packets=3)
    if name == "csma":
        return Csma(world, wifi_g(), seed=seed, limits=limits)
    if name == "tdma":
        return Tdma(world, RATE, Schedule.equal(tuple(NODES), 20_000_000, 0), limits)
    return AirTime(world, RATE, limits)


@st.composite
def routers(draw: st.DrawFn) -> HopRouter:
    ids = [str(node) for node in NODES]
    draws, forwarding = (
        Draws(draw(st.integers(1, 1000))),
        Forwarding(0, draw(st.sampled_from((0, 5_000_000)))),
    )
    kind = draw(st.sampled_from(("flood", "static", "mesh")))
    if kind == "flood":
        return Flood(ids, draws, forwarding, draw(st.integers(1, 6)), 4)
    if kind == "mesh":
        return Mesh(ids, draws, forwarding, MeshNumbers(interval_s=0.2, purge_s=2.0))
    routes = {
        str(node): {
            str(to): str(draw(st.sampled_from([n for n in NODES if n != node]))) for to in NODES if to != node
        }
        for node in NODES
    }
    while (back := leads_back(routes)) is not None:
        node, to, _ = back
        routes[node][to] = to
    numbers = {int(n): {int(to): int(via) for to, via in by.items()} for n, by in routes.items()}
    return Static(ids, draws, forwarding, numbers, 4)


@st.composite
def packets(draw: st.DrawFn) -> list[AirPacket]:
    found = []
    for number in range(draw(st.integers(1, 12))):
        node = draw(st.sampled_from(NODES))
        others = [each for each in NODES if each != node]
        to = draw(st.sampled_from([None, *others]))
        members = None
        if to is None and draw(st.booleans()):
            members = frozenset(draw(st.sets(st.sampled_from(NODES), min_size=1)))
        found.append(
            AirPacket(
                node,
                number,
                to,
                draw(st.integers(0, 300)),
                draw(st.integers(SENT_FROM_NS, SENT_TO_NS)),
                draw(st.integers(0, 2)),
                draw(st.sampled_from((None, 5_000_000, 100_000_000))),
                draw(st.sampled_from(("", "state"))),
                members,
            )
        )
    return found


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(
    router=routers(),
    sent=packets(),
    deaf=st.sets(st.sampled_from(LINKS)),
    loss=st.sampled_from((0.0, 0.3)),
    medium=st.sampled_from(("airtime", "csma", "tdma")),
)
def test_each_packet_has_one_fate_at_each_receiver_and_no_way_goes_back(
    router: HopRouter, sent: list[AirPacket], deaf: set[tuple[int, int]], loss: float, medium: str
) -> None:
    world = PlainWorld(NODES, deaf=sorted(deaf), loss=loss)
    network = Routed(media(medium, world, 1), router)
    for packet in sent:
        network.offer(packet)
    outcomes = network.live(END_NS)
    fates = [each for each in outcomes if isinstance(each, AirFate)]
    expected = Counter((packet.number, rx) for packet in sent for rx in NODES if packet.is_for(rx))
    assert Counter((fate.packet.number, fate.receiver) for fate in fates) == expected
    for fate in fates:
        assert fate.packet is sent[fate.packet.number]
        assert fate.at_ns >= fate.packet.at_ns
        if fate.loss is None:
            assert fate.way[0] == fate.packet.node
            assert len(set(fate.way) | {fate.receiver}) == len(fate.way) + 1
            assert all(
                (a, b) not in deaf for a, b in zip(fate.way, (*fate.way[1:], fate.receiver), strict=True)
            )
    assert {reply.packet.to for reply in outcomes if isinstance(reply, Reply)}.isdisjoint({None})
