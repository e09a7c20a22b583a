"""What every medium does with its packets, and what overlapping frames do to each other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from channel.access.air import Hearing
from channel.access.media.airtime import AirTime
from channel.access.media.csma import Csma, DcfSettings
from channel.access.media.delay import Delay, DelaySettings, WayDelay
from channel.access.media.elrs import Elrs
from channel.access.media.medium import AccessMedium
from channel.access.media.sik.medium import Sik
from channel.access.media.tdma import Schedule, Tdma
from channel.access.packets import AirFate, AirFrame, AirPacket, Loss, Outcome, Reply
from channel.access.queue import QueueLimits, TransmitQueue
from channel.access.settings.base import Surroundings
from channel.access.settings.csma import CsmaMedium
from channel.access.timing import BitRate, wifi_a, wifi_b, wifi_g
from channel.access.world import Piece, PlainWorld, World
from channel.link.radio import Radio
from channel.network.radio_world import RadioWorld
from channel.presets import load_radio

MS, S = 1_000_000, 1_000_000_000
UNLIMITED = QueueLimits(0)
KBPS_80 = BitRate(80_000.0)
"""100 bytes take 10 ms."""
MEDIA: dict[str, Callable[[World], AccessMedium]] = {
    "airtime": lambda world: AirTime(world, BitRate(4e6), QueueLimits(3)),
    "csma": lambda world: Csma(world, wifi_g(), limits=QueueLimits(3)),
    "tdma": lambda world: Tdma(
        world, KBPS_80, Schedule.equal(tuple(world.nodes), 20 * MS, MS), QueueLimits(3)
    ),
}


PAIRED: dict[str, Callable[[World], AccessMedium]] = {
    "delay": lambda world: Delay(
        world, DelaySettings(WayDelay(20 * MS, 45 * MS, 120 * MS), keeps_order=False)
    ),
    "sik": lambda world: Sik(world),
    "elrs": lambda world: Elrs(world),
}


def losses(outcomes: list[Outcome]) -> list[Loss | None]:
    """Of the fates, in their order."""
    return [one.loss for one in outcomes if isinstance(one, AirFate)]


def traffic(nodes: list[int], count: int, seed: int) -> list[AirPacket]:
    """Packets of all kinds at random, in the order of their instants."""
    rng = np.random.default_rng(seed)
    instants = np.sort(rng.integers(0, 3 * S, count))
    packets = []
    for number, at_ns in enumerate(instants.tolist()):
        node, other = rng.choice(nodes, 2, replace=False).tolist()
        to = other if rng.random() < 0.5 else None
        lifetime_ns = int(rng.integers(1, 200)) * MS if rng.random() < 0.3 else None
        key = "state" if rng.random() < 0.3 else ""
        length_bytes = int(rng.integers(0, 3000))
        packets.append(
            AirPacket(node, number, to, length_bytes, at_ns, int(rng.integers(0, 3)), lifetime_ns, key)
        )
    return packets


@pytest.mark.parametrize("name", MEDIA)
@pytest.mark.parametrize("seed", range(5))
def test_each_packet_has_one_fate_per_receiver(name: str, seed: int) -> None:
    """Whatever is sent: what was sent is what arrived and what was lost, once the queues are empty."""
    nodes = list(range(5))
    medium = MEDIA[name](PlainWorld(nodes, loss=0.1, delay_ns=300))
    packets = traffic(nodes, 300, seed)
    for packet in packets:
        medium.offer(packet)
    outcomes = medium.run(1000 * S)
    fates = Counter((one.packet, one.receiver) for one in outcomes if isinstance(one, AirFate))
    assert fates == Counter((packet, to) for packet in packets for to in medium.receivers_of(packet))
    arrived = [one for one in outcomes if isinstance(one, AirFate) and one.loss is None]
    assert arrived
    assert all(fate.packet.at_ns <= fate.started_ns < fate.ended_ns <= fate.at_ns for fate in arrived)
    if name == "csma":
        replies = Counter(one.packet for one in outcomes if isinstance(one, Reply))
        assert replies == Counter(packet for packet in packets if packet.to is not None)


@pytest.mark.parametrize("name", [*MEDIA, "delay", "sik", "elrs"])
def test_a_packet_to_a_group_is_on_the_air_as_one_to_all_and_has_fates_at_members_alone(name: str) -> None:
    """The medium with broadcasts is the oracle: members get the same, others nothing, and unicasts notice nothing."""
    nodes, members = list(range(5)), frozenset({1, 2, 4})
    open_medium = (MEDIA | PAIRED)[name]
    packets = traffic(nodes, 200, 7)

    def came(group: frozenset[int] | None) -> list[tuple[object, ...]]:
        medium = open_medium(PlainWorld(nodes, loss=0.1, delay_ns=300))
        for packet in packets:
            medium.offer(replace(packet, members=group if packet.to is None else None))
        return [
            (
                one.packet.node,
                one.packet.number,
                one.packet.to,
                one.receiver,
                one.loss,
                one.started_ns,
                one.at_ns,
            )
            for one in medium.run(20 * S)
            if isinstance(one, AirFate)
        ]

    to_all, to_group = came(None), came(members)
    assert to_group == [each for each in to_all if each[2] is not None or each[3] in members]
    assert 0 < len(to_group) < len(to_all)
    medium = open_medium(PlainWorld(nodes))
    heard = {
        packet: medium.receivers_of(replace(packet, members=members))
        for packet in packets
        if packet.to is None
    }
    assert {node for receivers in heard.values() for node in receivers} <= members


@pytest.mark.parametrize("name", MEDIA)
def test_it_matters_neither_how_it_is_run_nor_who_is_out_of_reach(name: str) -> None:
    """In one go, in pieces of a tick, or with bystanders that nobody hears: the same fates at the same instants."""
    nodes, packets = [0, 1, 2], traffic([0, 1, 2], 200, 3)
    bystanders = [7, 8, 9]
    deaf = [
        (a, b) for a in (*nodes, *bystanders) for b in (*nodes, *bystanders) if (a in nodes) != (b in nodes)
    ]

    def fates(medium: AccessMedium, step_ns: int) -> list[Outcome]:
        found: list[Outcome] = []
        waiting = list(packets)
        for until_ns in range(step_ns, 20 * S + 1, step_ns):
            while waiting and waiting[0].at_ns < until_ns:
                medium.offer(waiting.pop(0))
            found += medium.run(until_ns - 1)
        return [one for one in found if not isinstance(one, AirFate) or one.receiver in nodes]

    def world(extra: list[int]) -> PlainWorld:
        return PlainWorld([*nodes, *extra], loss=0.1, deaf=deaf)

    at_once = fates(MEDIA[name](world([])), 20 * S)
    assert fates(MEDIA[name](world([])), 50 * MS) == at_once
    if name != "tdma":  # whose rounds are longer with more nodes
        assert fates(MEDIA[name](world(bystanders)), 20 * MS) == at_once


def test_a_packet_takes_its_time_and_waits_for_the_one_before() -> None:
    """10 ms each at 80 kb/s, and 1 us of way."""
    medium = AirTime(PlainWorld((0, 1), delay_ns=1000), KBPS_80)
    for number in range(3):
        medium.offer(AirPacket(0, number, 1, 100, 5 * MS))
    arrivals = [one.at_ns for one in medium.run(S) if isinstance(one, AirFate)]
    assert arrivals == [15 * MS + 1000, 25 * MS + 1000, 35 * MS + 1000]


def test_who_transmits_hears_nothing() -> None:
    """Two that send to each other at once lose both, a third gets neither."""
    medium = AirTime(PlainWorld((0, 1, 2)), KBPS_80)
    medium.offer(AirPacket(0, 0, None, 100, 0))
    medium.offer(AirPacket(1, 0, None, 100, 5 * MS))
    fates = {(one.packet.node, one.receiver): one.loss for one in medium.run(S) if isinstance(one, AirFate)}
    assert fates == {
        (0, 1): Loss.HALF_DUPLEX,
        (1, 0): Loss.HALF_DUPLEX,
        (0, 2): Loss.COLLIDED,
        (1, 2): Loss.COLLIDED,
    }


@pytest.mark.parametrize(("ratio", "kept"), [(2.0, False), (20.0, True)])
def test_a_stronger_frame_comes_through(ratio: float, kept: bool) -> None:
    """By an SINR of ten; a later one takes the receiver over by capture alone."""
    powers = {(0, 2): 1e-7, (1, 2): ratio * 1e-7, (0, 1): 0.0, (1, 0): 0.0, (2, 0): 0.0, (2, 1): 0.0}

    def of_the_second(first: int, capture: float) -> dict[int, Loss | None]:
        world = PlainWorld((0, 1, 2), power_mw=powers, sinr_min=10.0)
        medium = AirTime(world, KBPS_80, hearing=Hearing(capture=capture))
        medium.offer(AirPacket(first, 0, 2, 100, 0))
        medium.offer(AirPacket(1 - first, 0, 2, 100, MS))
        return {one.packet.node: one.loss for one in medium.run(S) if isinstance(one, AirFate)}

    lost = Loss.COLLIDED
    assert of_the_second(1, np.inf) == {1: None if kept else lost, 0: lost}
    assert of_the_second(0, np.inf) == {1: lost, 0: lost}
    assert of_the_second(0, 10.0) == {1: None if kept else lost, 0: lost}


@pytest.mark.parametrize("capture", [np.inf, 4.0])
def test_collided_is_what_would_have_come_alone(capture: float) -> None:
    """Each sender is run by itself, too: it transmits at the same instants, with the same draws."""
    powers = {(a, b): 1e-7 * 3.0 ** ((2 * a + 3 * b) % 4) for a in range(5) for b in range(5)}

    def lost(senders: tuple[int, ...]) -> dict[tuple[int, int, int], Loss | None]:
        world = PlainWorld(range(5), power_mw=powers, loss=0.4, sinr_min=8.0, seed=4)
        medium = AirTime(world, KBPS_80, hearing=Hearing(capture=capture))
        rng = np.random.default_rng(5)
        for sender in range(4):
            for number, at_ns in enumerate(sorted(rng.integers(0, 5 * S, 60).tolist())):
                if sender in senders:
                    medium.offer(AirPacket(sender, number, None, 100, at_ns))
        fates = [one for one in medium.run(8 * S) if isinstance(one, AirFate)]
        return {(one.packet.node, one.packet.number, one.receiver): one.loss for one in fates}

    together, alone = lost((0, 1, 2, 3)), {}
    for sender in range(4):
        alone |= lost((sender,))
    wanted = {Loss.COLLIDED: None, Loss.NOISE: Loss.NOISE, None: None}
    found = Counter(loss for loss in together.values())
    assert min(found[loss] for loss in wanted) > 50
    assert all(alone[key] is wanted[loss] for key, loss in together.items() if loss in wanted)


def test_who_transmits_loses_what_was_lost_to_others_already() -> None:
    """Node 2 follows the first of two frames when it transmits: alone, the second would be lost, too."""
    medium = AirTime(PlainWorld((0, 1, 2), deaf=((0, 1), (1, 0))), KBPS_80)
    for node, at_ns in ((0, 0), (1, 5 * MS), (2, 8 * MS)):
        medium.offer(AirPacket(node, 0, 2 if node < 2 else 0, 100, at_ns))
    found = {one.packet.node: one.loss for one in medium.run(S) if isinstance(one, AirFate)}
    assert found == {0: Loss.HALF_DUPLEX, 1: Loss.HALF_DUPLEX, 2: Loss.HALF_DUPLEX}


def test_a_short_burst_of_interference_is_a_part_of_a_frame() -> None:
    """A frame of which a tenth is disturbed at 0 dB loses as many bits as that tenth has, no more."""
    radio = Radio(load_radio("corrected", {"error": {"model": "uncoded-awgn"}}))
    world = RadioWorld(radio, {0: (0.0, 0.0, -40.0), 1: (300.0, 0.0, -40.0)})
    frames = [AirFrame(0, number, "data", 100, 0, 1000) for number in range(4000)]
    [(_, power_mw, _)] = world.reach(frames[0])

    def came(disturbed_ns: int) -> float:
        pieces = [Piece(1000 - disturbed_ns, 0.0), Piece(disturbed_ns, power_mw / 5.0)]
        return float(np.mean([world.survives(frame, 1, power_mw, pieces)[0] for frame in frames]))

    share = {disturbed_ns: came(disturbed_ns) for disturbed_ns in (100, 500)}
    assert 0.0 < share[100] < 1.0
    assert share[500] == pytest.approx(share[100] ** 5, abs=0.04)


def test_rts_saves_hidden_senders() -> None:
    """Two that cannot hear each other send long unicasts to a third: with RTS they are done much sooner."""

    def done_s(rts_from_bytes: int | None) -> float:
        world = PlainWorld((0, 1, 2), deaf=((0, 1), (1, 0)))
        medium = Csma(world, wifi_a(), settings=DcfSettings(1000, rts_from_bytes), limits=QueueLimits(0))
        for node in (0, 1):
            for number in range(300):
                medium.offer(AirPacket(node, number, 2, 1500, 0))
        replies = [one for one in medium.run(1000 * S) if isinstance(one, Reply)]
        assert len(replies) == 600
        assert all(reply.acknowledged for reply in replies)
        return max(reply.at_ns for reply in replies) / S

    assert 600 * 2.1e-3 < done_s(0) < 0.75 * done_s(None)


def test_a_unicast_is_tried_so_often_and_given_up() -> None:
    """To a node that is deaf: seven times, then its sender is told."""
    medium = Csma(PlainWorld((0, 1), deaf=((0, 1),)), wifi_b())
    medium.offer(AirPacket(0, 0, 1, 100, 0))
    (fate, reply) = medium.run(S)
    assert isinstance(fate, AirFate)
    assert isinstance(reply, Reply)
    assert (fate.loss, fate.attempts, reply.acknowledged, reply.attempts) == (Loss.RETRIES, 7, False, 7)


def test_an_rts_that_nobody_answers_is_a_try_and_no_transmission_of_its_packet() -> None:
    medium = Csma(PlainWorld((0, 1), deaf=((0, 1),)), wifi_b(), settings=DcfSettings(rts_from_bytes=0))
    medium.offer(AirPacket(0, 0, 1, 100, 0))
    (fate, reply) = medium.run(S)
    assert isinstance(fate, AirFate)
    assert isinstance(reply, Reply)
    assert (fate.loss, fate.attempts, fate.started_ns) == (Loss.RETRIES, 0, -1)
    assert (reply.acknowledged, reply.attempts) == (False, 0)
    # seven waits for a CTS, DIFS and six back-offs: each RTS, at 1 Mb/s with a long preamble, takes 352 us
    assert reply.at_ns > 7 * 352_000 + 50_000


def test_a_packet_that_came_is_delivered_though_its_acknowledgement_is_lost() -> None:
    """Once, however often it is sent again."""
    medium = Csma(PlainWorld((0, 1), deaf=((1, 0),)), wifi_b())
    medium.offer(AirPacket(0, 0, 1, 100, 0))
    outcomes = medium.run(S)
    assert losses(outcomes) == [None]
    assert [one.acknowledged for one in outcomes if isinstance(one, Reply)] == [False]


def test_a_queue_holds_so_much_and_the_important_leaves_first() -> None:
    """Of three waiting places the fourth finds none; the priority decides, then the order."""
    medium = AirTime(PlainWorld((0, 1)), KBPS_80, QueueLimits(3))
    for number, priority in enumerate((0, 0, 5, 0, 0)):
        medium.offer(AirPacket(0, number, 1, 100, number * MS, priority))
    fates = [(one.packet.number, one.loss) for one in medium.run(S) if isinstance(one, AirFate)]
    assert fates == [(4, Loss.QUEUE_FULL), (0, None), (2, None), (1, None), (3, None)]


def test_what_is_too_old_or_was_replaced_does_not_leave_the_queue() -> None:
    """A newer packet of the same key takes the place of the older one; the life time is over the waiting alone."""
    medium = AirTime(PlainWorld((0, 1)), KBPS_80)
    medium.offer(AirPacket(0, 0, 1, 300, 0))
    medium.offer(AirPacket(0, 1, 1, 100, MS, key="state"))
    medium.offer(AirPacket(0, 2, 1, 100, 2 * MS, lifetime_ns=20 * MS))
    medium.offer(AirPacket(0, 3, 1, 100, 3 * MS, key="state"))
    fates = [(one.packet.number, one.loss) for one in medium.run(S) if isinstance(one, AirFate)]
    assert fates == [(1, Loss.REPLACED), (0, None), (2, Loss.EXPIRED), (3, None)]


def test_a_queue_is_bounded_in_bytes() -> None:
    """What does not fit is lost, what is shorter still fits."""
    outbox = TransmitQueue(QueueLimits(0, 250))
    assert [
        loss
        for length in (100, 100, 100, 50)
        for _, loss in outbox.put(AirPacket(0, length, 1, length, 0), 0)
    ] == [Loss.QUEUE_FULL]
    assert (len(outbox), outbox.length_bytes) == (3, 250)


def test_expired_packets_give_their_places_to_new_ones() -> None:
    """Five places, 10 packets a second with a life time of 0.2 s, a slot each 10 s: the two newest wait for it."""
    timing, schedule = BitRate(800_000.0), Schedule.equal((0, 1), 5 * S)
    medium = Tdma(PlainWorld((0, 1)), timing, schedule, QueueLimits(5))
    for number in range(1, 100):
        medium.offer(AirPacket(0, number, 1, 100, number * 100 * MS, lifetime_ns=200 * MS))
    fates = {one.packet.number: one for one in medium.run(11 * S) if isinstance(one, AirFate)}
    assert [fates[number].loss for number in range(1, 100)] == [Loss.EXPIRED] * 97 + [None] * 2
    assert {fates[number].at_ns - number * 100 * MS for number in range(1, 97)} == {300 * MS}


def test_an_expired_packet_gives_its_place_to_one_of_any_priority() -> None:
    """It is behind a more important one that stays; at the end of its life time it may still leave."""
    outbox = TransmitQueue(QueueLimits(2))
    old, fresh = AirPacket(0, 1, 1, 10, 0, lifetime_ns=MS), AirPacket(0, 2, 1, 10, MS, priority=9)
    assert outbox.put(AirPacket(0, 0, 1, 10, 0, priority=5), 0) == outbox.put(old, 0) == []
    assert outbox.put(fresh, MS) == [(fresh, Loss.QUEUE_FULL)]
    assert outbox.put(fresh, MS + 1) == [(old, Loss.EXPIRED)]
    assert (len(outbox), outbox.length_bytes) == (2, 20)


def test_a_packet_longer_than_a_frame_or_a_slot_is_too_long() -> None:
    """It is lost when it enters."""
    short = Tdma(PlainWorld((0, 1)), KBPS_80, Schedule.equal((0, 1), 10 * MS))
    short.offer(AirPacket(0, 0, 1, 101, 0))
    csma = Csma(PlainWorld((0, 1)), wifi_a())
    csma.offer(AirPacket(0, 0, 1, 2305, 0))
    assert losses(short.run(S)) == losses(csma.run(S)) == [Loss.TOO_LONG]


def test_a_node_without_a_slot_hears_and_has_no_room_for_its_packets() -> None:
    """They are lost as they enter and do not pile up, though its queue has no limit."""
    medium = Tdma(PlainWorld((0, 1)), KBPS_80, Schedule.equal((0,), 20 * MS), UNLIMITED)
    for number in range(3):
        medium.offer(AirPacket(1, number, 0, 100, number * MS))
    medium.offer(AirPacket(0, 0, 1, 100, 5 * MS))
    fates = [(one.packet.node, one.at_ns, one.loss) for one in medium.run(S) if isinstance(one, AirFate)]
    assert fates == [(1, number * MS, Loss.TOO_LONG) for number in range(3)] + [(0, 30 * MS, None)]
    assert medium.queued(1) == (0, 0)


@pytest.mark.parametrize(
    ("timing", "length_bytes", "us"),
    [
        (wifi_a(6.0, 6.0), 100 - 8, 196.0),
        (wifi_a(54.0, 54.0), 100 - 8, 40.0),
        (wifi_a(6.0, 6.0, clock=0.5), 100 - 8, 392.0),
        (wifi_b(1.0), 64, 192.0 + 800.0),
        (wifi_b(11.0), 500 - 36, 192.0 + 364.0),
        (wifi_b(11.0), 500, 582.0),
        (wifi_b(5.5), 500, 192.0 + 780.0),
        (wifi_b(11.0, short_preamble=True), 500, 96.0 + 390.0),
        (wifi_b(2.0, short_preamble=True), 64, 96.0 + 400.0),
        (wifi_b(1.0, short_preamble=True), 64, 192.0 + 800.0),
        (wifi_g(54.0), 100 - 8, 46.0),
    ],
)
def test_how_long_a_frame_lasts(timing: object, length_bytes: int, us: float) -> None:
    """128 and 100 bytes in all, by the clauses of the standard."""
    assert timing.duration_ns(length_bytes) == us * 1000  # type: ignore[attr-defined]


DATAGRAM_BYTES = 328
DATAGRAM_NS, RAW_NS = 554_000, 518_000
"""802.11g, 6 Mb/s: 20 us, symbols of 4 us for 22 + 8 (328 + 36 + 28) bits at 24 each, and 6 us; and without the 28."""


@pytest.mark.parametrize(("header_bytes", "frame_ns"), [(28, DATAGRAM_NS), (0, RAW_NS)])
def test_headers_of_the_layers_above_are_on_the_air_with_each_packet(
    header_bytes: int, frame_ns: int
) -> None:
    """Broadcast, and unicast in seven attempts; a frame's errors are those of all its bytes."""
    settings = DcfSettings(header_bytes=header_bytes)
    medium = Csma(PlainWorld((0, 1, 2), deaf=((0, 2),)), wifi_g(), settings=settings)
    packets = [
        AirPacket(0, number, to, DATAGRAM_BYTES, number * 100 * MS) for number, to in enumerate((None, 1, 2))
    ]
    for packet in packets:
        medium.offer(packet)
    fates = [one for one in medium.run(S) if isinstance(one, AirFate)]
    assert [(fate.receiver, fate.attempts) for fate in fates if fate.packet.to is not None] == [
        (1, 1),
        (2, 7),
    ]
    for fate in fates:
        assert fate.frame is not None
        assert fate.ended_ns - fate.started_ns == frame_ns
        assert fate.frame.length_bytes == DATAGRAM_BYTES + 36 + header_bytes
    foreseen = medium._stations[0].foreseen(packets[0])
    assert foreseen.ended_ns - foreseen.started_ns == frame_ns
    assert foreseen.length_bytes == DATAGRAM_BYTES + 36 + header_bytes


@pytest.mark.parametrize("rts_from_bytes", [None, 0])
def test_control_frames_have_no_headers_of_the_layers_above(rts_from_bytes: int | None) -> None:
    """14 bytes of ACK and CTS last 50 us, 20 of RTS 58, each after SIFS, and the NAV of an RTS counts the headers."""
    settings = DcfSettings(header_bytes=28, rts_from_bytes=rts_from_bytes)
    medium = Csma(PlainWorld((0, 1)), wifi_g(), settings=settings)
    medium.offer(AirPacket(0, 0, 1, DATAGRAM_BYTES, 0))
    fate, reply = medium.run(S)
    assert isinstance(reply, Reply)
    announced_ns = 0 if rts_from_bytes is None else 58_000 + 10_000 + 50_000 + 10_000
    assert isinstance(fate, AirFate)
    assert fate.started_ns == 28_000 + announced_ns
    assert reply.at_ns == fate.started_ns + DATAGRAM_NS + 10_000 + 50_000


@pytest.mark.parametrize(("header_bytes", "longest_bytes"), [(0, 2296), (28, 2268)])
def test_an_msdu_of_2304_bytes_has_llc_and_the_headers_of_the_layers_above_in_it(
    header_bytes: int, longest_bytes: int
) -> None:
    """IEEE 802.11-2020, 9.2.4.8.1; LLC and SNAP are 8 bytes."""
    medium = Csma(PlainWorld((0, 1)), wifi_g(), settings=DcfSettings(header_bytes=header_bytes))
    for number in range(2):
        medium.offer(AirPacket(0, number, None, longest_bytes + number, 0))
    too_long, came = (one for one in medium.run(S) if isinstance(one, AirFate))
    assert (too_long.packet.number, too_long.loss) == (1, Loss.TOO_LONG)
    assert (came.packet.number, came.loss) == (0, None)


def test_a_setting_has_the_headers_on_the_air_and_in_what_is_carried() -> None:
    """One broadcaster: DIFS of 28 us, 7.5 slots of 9 us, the frame."""
    for header_bytes, frame_ns in ((28, DATAGRAM_NS), (0, RAW_NS)):
        settings = CsmaMedium(header_bytes=header_bytes)
        carried_bps = 8 * DATAGRAM_BYTES / (28_000 + 7.5 * 9_000 + frame_ns) * 1e9
        assert settings.capacity_bps(DATAGRAM_BYTES, 0.0) == pytest.approx(carried_bps)
        surroundings = Surroundings(PlainWorld((0, 1)), {"0": 0, "1": 1}, 1, -95.0, {})
        medium = settings.open(surroundings)
        medium.offer(AirPacket(0, 0, None, DATAGRAM_BYTES, 0))
        [fate] = [one for one in medium.run(S) if isinstance(one, AirFate)]
        assert fate.ended_ns - fate.started_ns == frame_ns
    assert CsmaMedium().header_bytes == 0


def test_mistakes_are_said() -> None:
    """With what is wrong, and what is right."""
    medium = AirTime(PlainWorld((0, 1)), KBPS_80)
    with pytest.raises(ValueError, match="node 4 is not on this network: 0, 1"):
        medium.offer(AirPacket(4, 0, 1, 1, 0))
    with pytest.raises(ValueError, match="sends to itself"):
        medium.offer(AirPacket(1, 0, 1, 1, 0))
    medium.run(S)
    with pytest.raises(ValueError, match="it is 1000000000 ns already"):
        medium.offer(AirPacket(0, 0, 1, 1, 5))
    with pytest.raises(ValueError, match=r"802\.11b at 54 Mb/s: one of 1, 2, 5\.5, 11"):
        wifi_b(54.0)


def test_an_empty_packet_takes_a_moment() -> None:
    """At least a nanosecond: what ends has begun."""
    medium = AirTime(PlainWorld((0, 1)), BitRate(1e6))
    medium.offer(AirPacket(0, 0, None, 0, 0))
    assert losses(medium.run(S)) == [None]


def test_what_was_given_up_does_not_come_any_more() -> None:
    """Over a way of 30 km the only attempt is given up before it is there; it has one fate all the same."""
    medium = Csma(PlainWorld((0, 1), delay_ns=100_000), wifi_a(), settings=DcfSettings(attempts_max=1))
    medium.offer(AirPacket(0, 0, 1, 100, 0))
    assert losses(medium.run(S)) == [Loss.RETRIES]


@pytest.mark.parametrize(("reach_ns", "acknowledged"), [(0, False), (20_000, True)])
def test_answers_from_far_away_are_waited_for_if_asked(reach_ns: int, acknowledged: bool) -> None:
    """3 km are 10 us each way, longer than a slot."""
    world = PlainWorld((0, 1), delay_ns=10_000)
    medium = Csma(world, wifi_a(), settings=DcfSettings(reach_ns=reach_ns))
    medium.offer(AirPacket(0, 0, 1, 100, 0))
    assert [one.acknowledged for one in medium.run(S) if isinstance(one, Reply)] == [acknowledged]


def test_what_is_replaced_again_and_again_is_sent_in_its_turn() -> None:
    """The newest state has the place of the first one, also in a queue that never empties."""
    medium = AirTime(PlainWorld((0, 1)), BitRate(8e6), UNLIMITED)
    for number in range(0, 6000, 2):
        at_ns = number // 2 * 990_000
        medium.offer(AirPacket(0, number, 1, 1000, at_ns))
        medium.offer(AirPacket(0, number + 1, 1, 1000, at_ns, key="state"))
    fates = [one for one in medium.run(3 * S) if isinstance(one, AirFate)]
    assert sum(fate.loss is None and bool(fate.packet.key) for fate in fates) > 10


def test_a_packet_that_does_not_fit_into_its_slot_waits_in_the_queue() -> None:
    """There it expires, and lets what is more important go first."""
    medium = Tdma(PlainWorld((0, 1)), BitRate(800_000.0), Schedule.equal((0, 1), 10 * MS))
    for number, (at_ns, priority, lifetime_ns) in enumerate(
        [(0, 0, None), (0, 0, 9 * MS), (0, 0, None), (15 * MS, 5, None)]
    ):
        medium.offer(AirPacket(0, number, 1, 800, at_ns, priority, lifetime_ns))
    assert medium.run(9 * MS) != []
    assert medium.queued(0) == (2, 1600)
    fates = [(one.packet.number, one.loss) for one in medium.run(S) if isinstance(one, AirFate)]
    assert fates == [(1, Loss.EXPIRED), (3, None), (2, None)]


def test_a_packet_that_waits_too_long_for_a_busy_medium_expires() -> None:
    """A frame of 2000 bytes at 6 Mb/s takes 2.7 ms; DIFS is no waiting: a life time of 0 has a packet sent at once."""
    medium = Csma(PlainWorld((0, 1)), wifi_a())
    medium.offer(AirPacket(1, 0, None, 2000, 0))
    for number, lifetime_ns in enumerate((MS, None)):
        medium.offer(AirPacket(0, number, 1, 100, MS, lifetime_ns=lifetime_ns))
    medium.offer(AirPacket(0, 2, 1, 100, 500 * MS, lifetime_ns=0))
    outcomes = [one for one in medium.run(S) if one.packet.node == 0]
    fates = [(one.packet.number, one.loss, one.attempts) for one in outcomes if isinstance(one, AirFate)]
    assert fates == [(0, Loss.EXPIRED, 0), (1, None, 1), (2, None, 1)]
    replies = [(one.packet.number, one.acknowledged) for one in outcomes if isinstance(one, Reply)]
    assert replies == [(0, False), (1, True), (2, True)]


def test_a_basic_rate_is_one_of_the_standard_and_only_11b_has_a_short_preamble() -> None:
    for make, text in (
        (lambda: wifi_g(6.0, 7.0), "802.11g at a basic rate of 7 Mb/s: one of 6, 9, 12, 18, 24, 36, 48, 54"),
        (lambda: wifi_a(6.0, 1.0), "802.11a at a basic rate of 1 Mb/s: one of 6, "),
        (lambda: wifi_b(11.0, 6.0), "802.11b at a basic rate of 6 Mb/s: one of 1, 2, 5.5, 11"),
        (lambda: CsmaMedium(basic_rate_mbps=7.0), "a basic rate of 7 Mb/s"),
        (lambda: CsmaMedium(short_preamble=True), "short_preamble is for 11b only"),
        (lambda: CsmaMedium(standard="11a", short_preamble=True), "short_preamble is for 11b only"),
    ):
        with pytest.raises(ValueError, match=text):
            make()


def test_a_packet_that_finds_the_medium_idle_waits_difs() -> None:
    """However long it was idle before (10.3.4.2): 34 us with 802.11a, also when a back-off ran out unused."""
    medium = Csma(PlainWorld((0, 1)), wifi_a())
    for number in range(3):
        medium.offer(AirPacket(0, number, None, 100, number * 100 * MS))
    fates = [one for one in medium.run(S) if isinstance(one, AirFate)]
    assert [fate.started_ns - fate.packet.at_ns for fate in fates] == [34_000] * 3


def test_a_packet_draws_a_back_off_when_the_medium_gets_busy_within_its_difs() -> None:
    """It may not go on right after the other's frame: its slots are those of a back-off, 0 to 15."""
    slots = set()
    for seed in range(30):
        medium = Csma(PlainWorld((0, 1, 2)), wifi_a(), seed=seed)
        medium.offer(AirPacket(0, 0, None, 100, 0))
        medium.offer(AirPacket(1, 0, None, 100, 20_000))
        first, second = sorted({one.started_ns for one in medium.run(S) if isinstance(one, AirFate)})
        assert first == 34_000
        slots.add((second - first - wifi_a().broadcast_ns(100) - 34_000) / 9_000)
    assert slots <= set(range(16))
    assert len(slots) > 8


def test_a_packet_that_finds_the_nav_set_draws_a_back_off() -> None:
    """An RTS that nobody answers: the medium is busy by virtual carrier sense, though nothing is on the air."""
    slots = set()
    rts_ns, cts_ns, ack_ns = 52_000, 44_000, 44_000  # 20, 14, 14 bytes: 8, 6, 6 symbols
    for seed in range(30):
        world = PlainWorld((0, 1, 2), deaf=((0, 1),))
        medium = Csma(world, wifi_a(), seed=seed, settings=DcfSettings(1, rts_from_bytes=0))
        medium.offer(AirPacket(0, 0, 1, 1000, 0))
        medium.offer(AirPacket(2, 0, None, 100, 34_000 + rts_ns + 100_000))
        fates = [one for one in medium.run(S) if isinstance(one, AirFate)]
        [started_ns] = [one.started_ns for one in fates if (one.packet.node, one.receiver) == (2, 1)]
        nav_ns = 34_000 + rts_ns + cts_ns + wifi_a().duration_ns(1000) + ack_ns + 3 * 16_000
        slots.add((started_ns - nav_ns - 34_000) / 9_000)
    assert slots <= set(range(16))
    assert len(slots) > 8


def test_frames_at_1_mbps_have_the_long_preamble() -> None:
    """An ACK at 1 Mb/s: 192 + 112 us, as in EIFS; at 2 Mb/s 96 + 56."""
    assert [wifi_b(11.0, basic, short_preamble=True).control_ns(14) for basic in (1.0, 2.0)] == [
        304_000,
        152_000,
    ]
    assert wifi_b(11.0, 2.0, short_preamble=True).eifs_ns == 364_000
    assert wifi_b(11.0, short_preamble=True).broadcast_ns(64) == 992_000


def test_eifs_is_as_long_at_every_basic_rate() -> None:
    """By an ACK at the lowest rate of the PHY: 10 + 304 + 50 us for 802.11b, 16 + 44 + 34 for 802.11a."""
    assert {wifi_b(11.0, basic).eifs_ns for basic in (1.0, 2.0, 11.0)} == {364_000}
    assert {wifi_a(24.0, basic).eifs_ns for basic in (6.0, 24.0)} == {94_000}
    assert wifi_a(clock=0.5).eifs_ns == 32_000 + 88_000 + 58_000


def test_the_nav_is_followed_by_difs_though_a_frame_was_damaged() -> None:
    """EIFS counts from the damaged frame alone (10.3.2.3.7): a NAV that lasts longer ends it."""
    station = Csma(PlainWorld((0, 1)), wifi_a())._stations[0]
    station.idle(damaged=True, since_ns=0)
    assert station._counts_from_ns() == 94_000
    station.heard(AirFrame(1, 0, "cts", 14, 0, 1, to=5, reserved_ns=80_000))
    assert station._counts_from_ns() == 80_000 + 34_000


@pytest.mark.parametrize(("apart_ns", "collide"), [(3_000, True), (5_000, False)])
def test_a_carrier_takes_its_time_to_be_sensed(apart_ns: int, collide: bool) -> None:
    """Two whose packets come within it collide, though both listen."""
    medium = Csma(PlainWorld((0, 1, 2)), wifi_a(), hearing=Hearing(cca_ns=4_000))
    medium.offer(AirPacket(0, 0, None, 100, 0))
    medium.offer(AirPacket(1, 0, None, 100, apart_ns))
    lost = {one.loss for one in medium.run(S) if isinstance(one, AirFate) and one.receiver == 2}
    assert lost == {Loss.COLLIDED if collide else None}


def test_a_late_acknowledgement_is_not_taken_for_that_of_the_next_packet() -> None:
    """Ways of 60 km with the time-out of 3 km: answers come too late, and each packet still has one fate."""
    world = PlainWorld((0, 1), delay_ns=200_000, loss=0.4, seed=3)
    medium = Csma(world, wifi_a(6.0), seed=2, settings=DcfSettings(reach_ns=20_000), limits=QueueLimits(0))
    for number in range(300):
        medium.offer(AirPacket(0, number, 1, 100, number * 20 * MS))
    outcomes = medium.run(20 * S)
    fates = [one.packet.number for one in outcomes if isinstance(one, AirFate)]
    came = {one.packet.number for one in outcomes if isinstance(one, AirFate) and one.loss is None}
    told = {one.packet.number for one in outcomes if isinstance(one, Reply) and one.acknowledged}
    assert sorted(fates) == list(range(300))
    assert told <= came
