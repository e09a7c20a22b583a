"""A mesh against the numbers of batman-adv, by arithmetic: quality, windows, the time in which a route is found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import pytest

from channel.access.media.airtime import AirTime
from channel.access.media.csma import Csma, DcfSettings
from channel.access.packets import AirFate, AirFrame, AirPacket, Loss, Reply
from channel.access.timing import BitRate, wifi_g
from channel.access.world import Arrival, PlainWorld
from channel.draws import Draws
from channel.routing.mesh.mesh import Mesh, MeshNumbers
from channel.routing.mesh.originator import Ogm, after_hop, combined
from channel.routing.routed import Routed
from channel.routing.router import Forwarding, Hop

INTERVAL_S, JITTER_S = 1.0, 0.02
HOP_S = JITTER_S / 2 + 0.001
"""A message is handed on within half the jitter; on the air it takes far less than the rest."""
FAST = BitRate(10e6)


class Failing(PlainWorld):
    """A world in which a node falls silent at an instant."""

    def __init__(self, nodes: int, linked: Callable[[int, int], bool], silent: int, from_ns: int) -> None:
        deaf = [(a, b) for a in range(nodes) for b in range(nodes) if a != b and not linked(a, b)]
        super().__init__(range(nodes), deaf=deaf)
        self._silent, self._from_ns = silent, from_ns

    def reach(self, frame: AirFrame) -> Sequence[Arrival]:
        """Nothing comes from it, or to it, from then on."""
        found = super().reach(frame)
        if frame.started_ns < self._from_ns:
            return found
        if frame.node == self._silent:
            return []
        return [each for each in found if each.receiver != self._silent]


def ring(nodes: int) -> Callable[[int, int], bool]:
    return lambda a, b: (a - b) % nodes in (1, nodes - 1)


def row(a: int, b: int) -> bool:
    return abs(a - b) == 1


def mesh(nodes: int, seed: int = 1, numbers: MeshNumbers | None = None) -> Mesh:
    return Mesh([str(node) for node in range(nodes)], Draws(seed), Forwarding(0, 0), numbers)


def second(at_s: float) -> int:
    return round(at_s * 1e9)


@pytest.mark.parametrize(
    ("received", "echoed", "quality"),
    [
        (64, 64, 255),
        (64, 32, 127),  # 255 * 32 / 64
        (32, 32, 224),  # 255 - 255 * 32^3 / 64^3 = 255 - 31
        (32, 16, 111),  # 127 * 224 / 255
        (0, 10, 0),
        (10, 0, 0),
    ],
)
def test_the_quality_of_a_link_is_that_of_batman_adv(received: int, echoed: int, quality: int) -> None:
    """tq_own = 255 e / r, asymmetry = 255 - 255 (64 - r)^3 / 64^3, each division cut to whole numbers."""
    assert combined(255, received, echoed, 255) == quality


def test_each_hop_takes_thirty_of_255() -> None:
    assert after_hop(255, 30) == 225
    assert after_hop(225, 30) == 198  # 225 * 225 / 255 = 198.5


def test_in_a_row_quality_falls_with_each_hop_as_over_half_duplex_radios() -> None:
    """When windows are full: what is handed on loses 30 of 255 for the radio and 30 for the hop, cut at each step."""
    router = mesh(4)
    network = Routed(AirTime(PlainWorld(range(4), deaf=_deaf(4, row)), FAST), router)
    network.live(second(80.0))
    for hops, expected in ((1, 255), (2, 225 * 225 // 255), (3, None)):
        told = 255
        for _ in range(hops - 1):
            told = (told * 225 // 255) * 225 // 255
        quality = router.stations[0].quality_of(hops, 1)
        assert quality == told
        assert expected in (None, told)
        assert router.stations[0].next_to(hops) == 1


def _deaf(nodes: int, linked: Callable[[int, int], bool]) -> list[tuple[int, int]]:
    return [(a, b) for a in range(nodes) for b in range(nodes) if a != b and not linked(a, b)]


def test_messages_come_each_second_and_every_neighbour_hands_them_on() -> None:
    """Two nodes, a minute: 60 each of one's own, and 60 of the other's; 24 bytes, 19.2 us at 10 Mb/s."""
    network = Routed(AirTime(PlainWorld(range(2)), FAST), mesh(2))
    network.live(second(60.0))
    counts = network.counts
    assert counts.notices == pytest.approx(4 * 60, abs=4)
    assert counts.notice_bytes == 24 * counts.notices
    assert counts.notice_air_ns == 19_200 * counts.notices


def test_messages_are_ethernet_frames_without_headers_of_ip_and_packets_have_them() -> None:
    """802.11g, 6 Mb/s, UDP in IP: 24 + 36 bytes are 21 symbols, 100 + 24 + 28 + 36 are 64; 20 us before, 6 after."""
    network = Routed(Csma(PlainWorld(range(2)), wifi_g(), settings=DcfSettings(header_bytes=28)), mesh(2))
    network.live(second(10.0))
    counts = network.counts
    assert counts.notices > 30
    assert counts.notice_air_ns == (20 + 4 * 21 + 6) * 1000 * counts.notices
    network.offer(AirPacket(0, 0, 1, 100, second(10.0) + 1))
    [fate] = [each for each in network.live(second(11.0)) if isinstance(each, AirFate)]
    assert (fate.loss, fate.ended_ns - fate.started_ns) == (None, (20 + 4 * 64 + 6) * 1000)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.long) for seed in (2, 3))])
def test_ten_nodes_find_a_way_around_a_lost_relay_when_the_constants_say(seed: int) -> None:
    """A ring of ten; 0 sends to 3 over 1 and 2, and node 1 falls silent: seven hops the other way are left.

    The mean over the last five messages of 3 forgets a neighbour with the fifth that it did not bring: the first node
    turns with the fifth message after the silence. It hands on the messages after that alone, so that the next one
    turns with the tenth, and the k-th with the (5 k)-th: 5 k - 1 to 5 k intervals after the silence, give or take the
    jitter of each and seven hops of a message.
    """
    silent_s, step_s = 80.0, 0.01
    router = mesh(10, seed)
    network = Routed(AirTime(Failing(10, ring(10), 1, second(silent_s)), FAST), router)
    network.live(second(silent_s) - 1)
    assert router.stations[0].next_to(3) == 1
    turns = [node for node in (8, 9, 0) if router.stations[node].next_to(3) == (node + 1) % 10]
    assert turns[-2:] == [9, 0]  # 8 is as far from 3 on both sides
    turned_s: dict[int, float] = {}
    for step in range(1, 2000):
        network.live(second(silent_s + step_s * step))
        for node in turns:
            if router.stations[node].next_to(3) == (node - 1) % 10:
                turned_s.setdefault(node, step_s * step)
    for place, node in enumerate(turns, start=1):
        messages = 5 * place
        assert (messages - 1) * (INTERVAL_S - JITTER_S) < turned_s[node]
        assert turned_s[node] < messages * (INTERVAL_S + JITTER_S) + 7 * HOP_S + step_s
    network.offer(AirPacket(0, 0, 3, 100, second(100.0) + 1))
    [fate] = [each for each in network.live(second(101.0)) if isinstance(each, AirFate)]
    assert (fate.loss, fate.way) == (None, (0, 9, 8, 7, 6, 5, 4))


def test_a_node_that_is_gone_is_forgotten_after_the_purge_time() -> None:
    """Its route stays until the neighbour over whom it was heard has been silent for so long; 20 s here."""
    silent_s, purge_s = 70.0, 20.0
    router = mesh(3, numbers=MeshNumbers(purge_s=purge_s))
    network = Routed(AirTime(Failing(3, row, 2, second(silent_s)), FAST), router)
    station = router.stations[0]
    network.live(second(silent_s + purge_s - 2 * INTERVAL_S))
    assert station.next_to(2) == 1
    network.live(second(silent_s + purge_s + 2 * INTERVAL_S))
    assert station.next_to(2) is None
    assert station.next_to(1) == 1
    network.offer(AirPacket(0, 0, 2, 100, second(silent_s + purge_s + 2 * INTERVAL_S) + 1))
    at_ns = second(silent_s + purge_s + 2 * INTERVAL_S) + 1
    fate, reply = network.live(second(silent_s + purge_s + 3.0))
    assert isinstance(fate, AirFate)
    assert (fate.loss, fate.started_ns) == (Loss.NO_ROUTE, -1)
    assert reply == Reply(AirPacket(0, 0, 2, 100, at_ns), at_ns, acknowledged=False, attempts=0)


def test_what_is_for_all_is_sent_three_times_by_each_node_that_has_others_to_tell() -> None:
    """A row of three: 0 and 1 send thrice, 5 ms apart; 2 has no neighbour but the one it had it from."""
    router = mesh(3)
    network = Routed(AirTime(PlainWorld(range(3), deaf=_deaf(3, row)), FAST), router)
    network.live(second(10.0))
    before = network.counts.sent, network.counts.handed_on
    assert before == (0, 0)
    network.offer(AirPacket(0, 0, None, 100, second(10.0) + 1))
    found = [each for each in network.live(second(11.0)) if isinstance(each, AirFate)]
    assert [(each.receiver, each.loss, each.way) for each in found] == [(1, None, (0,)), (2, None, (0, 1))]
    assert (network.counts.sent, network.counts.handed_on) == (3, 3)
    assert network.counts.duplicates == 2 + 3 + 2  # at 1 of 0, at 0 of 1, at 2 of 1


def test_copies_of_a_packet_with_a_key_do_not_replace_each_other_and_newer_packets_do() -> None:
    """A frame of 100 bytes and 14 is on the air for 114 ms: when it ends, both later copies wait behind it."""
    router = mesh(2)
    network = Routed(AirTime(PlainWorld(range(2)), BitRate(8e3)), router)
    network.live(second(10.0))

    def sent(at_s: float, numbers: range) -> int:
        before = network.counts.sent
        for number in numbers:
            at_ns = second(at_s + 0.02 * (number - numbers.start)) + 1
            network.offer(AirPacket(0, number, None, 100, at_ns, key="position"))
        found = [each for each in network.live(second(at_s + 2.0)) if isinstance(each, AirFate)]
        assert [each.receiver for each in found] == [1] * len(numbers)
        assert {each.loss for each in found} <= {None, Loss.REPLACED}
        return network.counts.sent - before

    assert sent(10.0, range(1)) == 3
    assert sent(20.0, range(1, 3)) == 1 + 3
    assert sent(30.0, range(3, 8)) == 1 + 3


def test_an_originator_that_nobody_heard_of_floods_nothing() -> None:
    """batman-adv drops broadcasts of originators that it does not know."""
    router = mesh(2)
    assert router.refuses(1, AirPacket(0, 0, None, 100, 0)) is Loss.NO_ROUTE
    router.take(1, 0, Ogm(0, 1, 50, 255, 0), 0)
    assert router.refuses(1, AirPacket(0, 0, None, 100, 0)) is None


def test_packets_of_others_go_where_neighbours_are_told_that_they_do() -> None:
    """`batadv_route_unicast_packet` asks for the route of the interface that a packet came from.

    Over 1 the way is worth 8, over 2 then 9: less 30 of 255 for the radio that is used again both are 7, and the first
    one stays.
    """
    router = mesh(4)
    for number in range(1, 66):
        router.notices(0, 0)
        for neighbour in (1, 2):
            router.take(0, neighbour, Ogm(neighbour, number, 50, 255, neighbour), 0)
            router.take(0, neighbour, Ogm(0, number, 49, 225, 0, is_direct=True), 0)
    for number in range(1, 12):
        router.take(0, 1, Ogm(3, number, 49, 8, 3), 0)
        router.take(0, 2, Ogm(3, number, 49, 9, 3), 0)
    packet = AirPacket(0, 0, 3, 100, 0)
    assert [router.stations[0].quality_of(3, neighbour) for neighbour in (1, 2)] == [8, 9]
    assert router.send(0, packet) == [Hop(2)]
    assert router.hand_on(0, replace(packet, node=1), [1]) == [Hop(1)]
    for to in (None, 3):
        assert router.hand_on(0, replace(packet, node=1, to=to), [1] * 50) is Loss.HOP_LIMIT


def test_an_originator_is_known_as_long_late_in_a_run_as_at_its_beginning() -> None:
    """2 hears 1, who does not hear 2: what 1 hands on makes 0 known, and no more, until twice the purge time later."""
    links = {(0, 1), (1, 0), (1, 3), (3, 1), (1, 2)}
    world = PlainWorld(range(4), deaf=_deaf(4, lambda a, b: (a, b) in links))
    network = Routed(AirTime(world, FAST), mesh(4, numbers=MeshNumbers(interval_s=0.5, purge_s=10.0)))
    for number in range(150):
        network.offer(AirPacket(0, number, None, 50, second(25.0 + 0.1 * number)))
    fates = [each for each in network.live(second(42.0)) if isinstance(each, AirFate) and each.receiver == 2]
    lost = [each.packet.at_ns for each in fates if each.loss is not None]
    assert len(fates) == 150
    assert len(lost) <= 6  # once, until the next message
    assert not lost or max(lost) - min(lost) <= second(0.52)


def test_what_a_radio_that_is_off_is_given_is_lost_to_that_and_not_for_want_of_a_route() -> None:
    """A mesh whose node is off from the start knows no other."""

    class Off(PlainWorld):
        def is_off(self, node: int, at_ns: int) -> bool:
            """Node 0, always."""
            del at_ns
            return node == 0

    network = Routed(AirTime(Off(range(2)), FAST), mesh(2))
    network.offer(AirPacket(0, 0, 1, 100, second(1.0)))
    network.offer(AirPacket(0, 1, None, 100, second(2.0)))
    outcomes = network.live(second(3.0))
    assert [each.loss for each in outcomes if isinstance(each, AirFate)] == [Loss.RADIO_OFF] * 2
    [reply] = [each for each in outcomes if isinstance(each, Reply)]
    assert (reply.packet.number, reply.acknowledged, reply.at_ns) == (0, False, second(1.0))
