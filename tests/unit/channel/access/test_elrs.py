"""ExpressLRS: slots, fragments, stop and wait, buffers and links, against arithmetic and the firmware's own figures."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from math import ceil
from pathlib import Path

import numpy as np
import pytest

from channel.access.media.elrs import ELRS_MODES, Elrs, ElrsMode, ElrsSettings, hop_sequence
from channel.access.packets import AirFate, AirFrame, AirPacket, Loss, Outcome, Reply
from channel.access.stubborn import NOTHING, Fragment, StubbornReceiver, StubbornSender, are_whole
from channel.access.words import WordStream
from channel.access.world import Arrival, Piece, PlainWorld
from channel.draws import Draws

MS, S = 1_000_000, 1_000_000_000
CHUNK_BYTES = 62
FLRC = ELRS_MODES["flrc-1000"]
LORA_500 = ELRS_MODES["lora-500"]


def fates(outcomes: list[Outcome]) -> list[AirFate]:
    """Without replies."""
    return [one for one in outcomes if isinstance(one, AirFate)]


def carried(medium: Elrs, node: int, until_s: int) -> float:
    """User bytes per second of a node that always has something to send, in packets as long as a chunk."""
    number = came = 0
    for at_ns in range(0, until_s * S, 100 * MS):  # of 838 bytes that wait 250 leave meanwhile
        for _ in range((900 - medium.queued(node)[1]) // CHUNK_BYTES):
            medium.offer(AirPacket(node, number, 1 - node, CHUNK_BYTES, at_ns))
            number += 1
        came += sum(fate.loss is None for fate in fates(medium.run(at_ns + 100 * MS - 1)))
    return came * CHUNK_BYTES / until_s


@pytest.mark.parametrize(
    ("name", "interval_us", "dbm", "air_us", "data_bytes", "down"),
    [
        ("flrc-1000", 1000, -104, 389, 5, 2490),
        ("lora-500", 2000, -105, 1507, 5, 1240),
        ("lora-333-full", 3003, -105, 2374, 10, 1645),
        ("lora-150", 6666, -112, 5871, 5, 365),
        ("lora-50", 20000, -115, 10798, 5, 114),
        ("900-200", 5000, -112, 4380, 5, 490),
        ("900-100-full", 10000, -112, 6690, 10, 480),
        ("900-25", 40000, -123, 29950, 5, 52),
    ],
)
def test_modes(name: str, interval_us: int, dbm: float, air_us: int, data_bytes: int, down: float) -> None:
    """As read in the firmware, with the bytes per second that it tells its users at 1:2."""
    mode = ELRS_MODES[name]
    assert (mode.interval_us, mode.sensitivity_dbm, mode.air_us) == (interval_us, dbm, air_us)
    assert mode.data_bytes == data_bytes
    assert mode.down_bytes_per_s == pytest.approx(down, abs=1.0)


@pytest.mark.parametrize(
    ("name", "factor", "rate", "preamble"),
    [("900-200", 6, 7, 8), ("900-100-full", 6, 8, 8), ("900-25", 9, 7, 10)],
)
def test_air_times_are_those_of_lora(name: str, factor: int, rate: int, preamble: int) -> None:
    """Semtech's formula (SX1276, 4.1.1.7): implicit header, no CRC, 500 kHz, code rate 4 / ``rate``."""
    mode = ELRS_MODES[name]
    symbol_us = 2**factor / 0.5
    groups = ceil((8 * mode.packet_bytes - 4 * factor + 28 - 20) / (4 * factor))
    assert mode.air_us == pytest.approx((preamble + 4.25 + 8 + groups * rate) * symbol_us, rel=2e-3)


ROOM_BYTES_PER_S = {
    "flrc-1000": 2490.2,
    "lora-500": 1240.2,
    "lora-333-full": 1645.3,
    "lora-150": 365.1,
    "lora-50": 114.6,
    "900-200": 490.2,
    "900-100-full": 480.0,
    "900-25": 52.1,
}
"""Room in data packets, by the arithmetic of the firmware's `updateTlmBandwidth`: bytes of a packet * burst * hz / 2 /
(burst + 1), without the 6 bytes/s that it adds for packets of 13 bytes as an approximation."""
FIRMWARE_BYTES_PER_S = {
    "flrc-1000": (2375.3, 2373.4, 2374.4),
    "lora-500": (1183.0, 1170.1, 1182.0),
    "lora-333-full": (1474.7, 1472.5, 1473.2),
    "lora-150": (348.3, 346.9, 347.0),
    "lora-50": (109.3, 105.5, 108.5),
    "900-200": (467.6, 466.1, 466.3),
    "900-100-full": (442.8, 439.9, 441.4),
    "900-25": (49.7, 44.4, 48.4),
}
"""User bytes that the firmware's own sender and receiver carry down: without sync; with it the least and the most.

By `benchmarks/channel/elrs/stubborn.cc`: `StubbornSender` and `StubbornReceiver` of commit 7702d0f, called slot by slot
for 2000 s as `rx_main.cpp` and `tx_main.cpp` do, chunks of 62 bytes always waiting; with sync from 20 places
in its cycles.
"""


class Listening(PlainWorld):
    """A world that counts frames by their sender and kind."""

    def __init__(self) -> None:
        super().__init__((0, 1))
        self.frames: Counter[tuple[int, str]] = Counter()
        self.first_ns = -1

    def reach(self, frame: AirFrame) -> Sequence[Arrival]:
        """All hear it."""
        self.frames[frame.node, frame.kind] += 1
        if self.first_ns < 0:
            self.first_ns = frame.started_ns
        return super().reach(frame)


def duration_s(mode: ElrsMode) -> int:
    """For a few hundred chunks, or for the slow modes some dozens."""
    return 15 if mode.interval_us < 5000 else 120 if mode.interval_us < 20_000 else 400


@pytest.mark.slow
@pytest.mark.parametrize("name", ELRS_MODES)
def test_a_stream_down_is_as_fast_as_by_the_firmwares_own_code(name: str) -> None:
    """Below the figure for the room by the 2 bytes before a chunk, the rest of its last fragment, and sync.

    The room is that of the data packets on the air, sync and all, of a receiver that always has something to send. A
    sync confirms nothing: a fragment is sent again, and beside statistics that costs the chunk, or 41 rounds in vain.
    """
    mode = ELRS_MODES[name]
    alone, least, most = FIRMWARE_BYTES_PER_S[name]
    never = ElrsSettings(replace(mode, hop_slots=10**9))
    assert mode.user_bytes_per_s == pytest.approx(alone, rel=0.002)
    assert carried(Elrs(PlainWorld((0, 1)), never), 1, duration_s(mode)) == pytest.approx(alone, rel=0.01)
    for seed in (1, 2):
        world = Listening()
        seen = carried(Elrs(world, ElrsSettings(mode), seed=seed), 1, duration_s(mode))
        assert 0.99 * least < seen < 1.01 * most
        room_bytes_per_s = world.frames[1, "data"] * mode.data_bytes / duration_s(mode)
        assert room_bytes_per_s == pytest.approx(ROOM_BYTES_PER_S[name], rel=0.01)


@pytest.mark.parametrize("name", ["lora-150", "lora-50", "900-25"])
def test_the_page_has_what_is_carried_in_its_time(name: str) -> None:
    """docs/reference/air.md: room by the firmware's figure, user bytes in it, carried down and up in 200 s."""
    page = (Path(__file__).parents[4] / "docs" / "reference" / "air.md").read_text(encoding="utf-8")
    (row,) = re.findall(rf"^\| `{name}` \| (\d+) \| (\d+) \| (\d+) \| (\d+) \|$", page, re.MULTILINE)
    _, user, down, up = map(int, row)
    mode = ELRS_MODES[name]
    assert user == pytest.approx(mode.user_bytes_per_s, abs=0.51)
    for node, figure in ((1, down), (0, up)):
        assert figure == pytest.approx(
            carried(Elrs(PlainWorld((0, 1)), ElrsSettings(mode)), node, 200), abs=0.51
        )


@pytest.mark.parametrize("name", ["lora-333-full", "900-100-full"])
def test_packets_of_13_bytes_are_full_to_nine_tenths(name: str) -> None:
    """64 bytes of a chunk are 7 fragments of 10: 62 of 70 bytes; 6 bytes beside statistics take none more."""
    mode = ELRS_MODES[name]
    assert mode.user_bytes_per_s == pytest.approx(62 / 7 / (2e-6 * mode.interval_us))


@pytest.mark.parametrize(("has_rc", "slots"), [(False, 2), (True, 4)])
@pytest.mark.parametrize("name", ["lora-500", "lora-333-full"])
def test_what_a_transmitter_sends_in_full(name: str, has_rc: bool, slots: int) -> None:
    """64 bytes take 13 fragments of 5 or 7 of 10; one in two slots, or in four beside a remote control."""
    mode = ELRS_MODES[name]
    fragments = {5: 13, 10: 7}[mode.data_bytes]
    expected = CHUNK_BYTES / (fragments * slots * mode.interval_us * 1e-6)
    assert mode.user_bytes_up_per_s(has_rc=has_rc) == pytest.approx(expected)
    seen = carried(Elrs(PlainWorld((0, 1)), ElrsSettings(mode, has_rc=has_rc)), 0, 10)
    assert seen == pytest.approx(expected, rel=0.01)


def rounds_per_chunk(p: float) -> float:
    """Rounds of a fragment there and a confirmation back that a chunk of 13 fragments takes; each is lost by chance p.

    a: the fragment has not come. b: it has, but its confirmation has not. From b on only a confirmation is wanted:
    b = 1 / q, and a = 1 + p a + q p b = (1 + p) / q. The first fragment of a chunk turns the bit each time it comes.
    In c the bit is turned back: b = 1 + p p b + q c (not again, and confirmed: done; again: c), and
    c = 1 + p c + q p b (again, and confirmed: done).
    """
    q = 1.0 - p
    later = (1.0 + p) / q
    first, _, _ = np.linalg.solve(
        [[1.0 - p, -q * p, 0.0], [0.0, 1.0 - p * p, -q], [0.0, -q * p, 1.0 - p]], [1.0, 1.0, 1.0]
    )
    return float(first) + 12.0 * later


@pytest.mark.parametrize("node", [0, 1])
@pytest.mark.parametrize("p", [pytest.param(0.1, marks=pytest.mark.slow), 0.3])
def test_stop_and_wait_under_loss(node: int, p: float) -> None:
    """Up and down, in rounds of two slots.

    Each 256th packet down has statistics and one byte of data. It costs a chunk if it repeats what came (in b, which is
    p / (1 + p) of all rounds), or if it came itself and is repeated (in a, 1 / (1 + p), q p of these).
    """
    rounds, q = rounds_per_chunk(p), 1.0 - p
    damaged = rounds / 256 * (p + q * p) / (1.0 + p) if node else 0.0
    medium = Elrs(PlainWorld((0, 1), loss=p), ElrsSettings(FLRC, has_rc=False))
    seen = carried(medium, node, 40)
    assert seen == pytest.approx(CHUNK_BYTES / (rounds * 2e-3) * (1.0 - damaged), rel=0.02)
    assert rounds_per_chunk(0.0) == pytest.approx(13.0)


def test_a_packet_arrives_with_its_last_fragment() -> None:
    """At 500 Hz a receiver's 20 bytes and 2 are 5 fragments, in 5 of its slots, 1507 us after the start of the last."""
    medium = Elrs(PlainWorld((0, 1), delay_ns=1000), ElrsSettings(LORA_500, begins_us=0), seed=3)
    medium.offer(AirPacket(1, 0, 0, 20, 20 * MS))
    (fate,) = medium.run(S)
    assert isinstance(fate, AirFate)
    assert fate.loss is None
    first_slot_ns = 22 * MS  # odd slots are the receiver's: 2 ms after each 4 ms
    assert fate.at_ns == first_slot_ns + 4 * 4 * MS + 1_507_000 + 1000
    assert (fate.started_ns, fate.attempts) == (first_slot_ns + 16 * MS, 5)


def test_one_fragment_is_followed_by_an_empty_one() -> None:
    """3 bytes and 2 fit into one, and arrive with the second."""
    medium = Elrs(PlainWorld((0, 1)), ElrsSettings(LORA_500, begins_us=0), seed=3)
    medium.offer(AirPacket(1, 0, 0, 3, 20 * MS))
    (fate,) = medium.run(S)
    assert isinstance(fate, AirFate)
    assert fate.at_ns == 26 * MS + 1_507_000


def test_a_buffer_is_bounded() -> None:
    """Of 30 packets of 100 bytes the first goes into a chunk but for 38; with nine more there are 938 of 1024 bytes."""
    medium = Elrs(PlainWorld((0, 1)))
    for number in range(30):
        medium.offer(AirPacket(1, number, 0, 100, MS))
    medium.offer(AirPacket(1, 30, 0, 1025, MS))
    outcomes = medium.run(20 * S)
    losses = Counter(fate.loss for fate in fates(outcomes))
    assert losses == {None: 10, Loss.QUEUE_FULL: 20, Loss.TOO_LONG: 1}
    assert len([one for one in outcomes if isinstance(one, Reply)]) == 21


def test_a_newer_packet_replaces_the_older_one_in_a_full_buffer() -> None:
    """38 bytes of the first wait beside 800 and 100 of 1024: 100 in place of the 100 fit, 200 do not."""
    medium = Elrs(PlainWorld((0, 1)))
    for number in range(9):
        medium.offer(AirPacket(1, number, 0, 100, MS))
    for number, length_bytes in ((9, 100), (10, 100), (11, 200)):
        medium.offer(AirPacket(1, number, 0, length_bytes, MS, key="state"))
    found = {fate.packet.number: fate.loss for fate in fates(medium.run(20 * S))}
    assert found == dict.fromkeys(range(11)) | {9: Loss.REPLACED, 11: Loss.QUEUE_FULL}


def traffic(count: int, seed: int, nodes: Sequence[int] = (0, 1)) -> list[AirPacket]:
    """Unicasts and broadcasts of several lengths, at instants that are often a slot's."""
    rng = np.random.default_rng(seed)
    instants = np.sort(rng.integers(0, 10_000, count)) * MS
    return [
        AirPacket(
            int(rng.choice(nodes)), number, None, int(rng.integers(0, 150)), at_ns, int(rng.integers(0, 2))
        )
        for number, at_ns in enumerate(instants.tolist())
    ]


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", ["flrc-1000", "lora-333-full"])
def test_each_packet_has_one_fate_however_it_is_run(name: str, seed: int) -> None:
    """At a loss of a quarter: nothing comes twice, and packets of a node and priority come in their order."""
    packets = traffic(150, seed)

    def seen(step_ns: int) -> list[Outcome]:
        medium = Elrs(PlainWorld((0, 1), loss=0.25), ElrsSettings(ELRS_MODES[name]), seed=seed)
        waiting, outcomes = list(packets), []
        for until_ns in range(step_ns, 20 * S + 1, step_ns):
            while waiting and waiting[0].at_ns < until_ns:
                medium.offer(waiting.pop(0))
            outcomes += medium.run(until_ns - 1)
        return outcomes

    at_once = seen(20 * S)
    assert seen(50 * MS) == at_once
    assert Counter(fate.packet for fate in fates(at_once)) == Counter(packets)
    came = [fate.packet for fate in fates(at_once) if fate.loss is None]
    assert len(came) > 100
    for node in (0, 1):
        for priority in (0, 1):
            numbers = [one.number for one in came if (one.node, one.priority) == (node, priority)]
            assert numbers == sorted(numbers)


def test_pairs_do_not_disturb_each_other() -> None:
    """What a pair does is the same to the ns beside another that is full, and one that is nobody's has no link."""
    packets = traffic(100, 4)

    def seen(nodes: int) -> list[AirFate]:
        medium = Elrs(PlainWorld(range(nodes), loss=0.1))
        for packet in packets:
            medium.offer(packet)
        for number in range(500):
            for node in range(2, nodes):
                medium.offer(AirPacket(node, number, None, 100, number * 5 * MS))
        return [one for one in fates(medium.run(30 * S)) if one.packet.node < 2 and one.receiver < 2]

    assert seen(4) == seen(2)


def test_who_is_not_the_peer_hears_nothing() -> None:
    """Pairs as set; a broadcast is for the peer alone, as with SiK; a unicast to another is refused at once."""
    medium = Elrs(PlainWorld(range(5)), ElrsSettings(pairs=((3, 0), (1, 2))))
    for number, to in enumerate((None, 0, 1)):
        medium.offer(AirPacket(3, number, to, 10, MS))
    medium.offer(AirPacket(4, 0, None, 10, MS))
    outcomes = medium.run(S)
    seen = {(fate.packet.node, fate.packet.number, fate.receiver): fate.loss for fate in fates(outcomes)}
    assert seen == {(3, 0, 0): None, (3, 1, 0): None, (3, 2, 1): Loss.NO_PEER}
    groups = [
        AirPacket(3, 9, None, 10, S, members=members) for members in (frozenset({0, 1}), frozenset({1}))
    ]
    assert [medium.receivers_of(packet) for packet in groups] == [(0,), ()]
    assert [reply.packet.number for reply in outcomes if isinstance(reply, Reply)] == [2]


def test_a_packet_comes_in_as_many_pieces_as_it_has_chunks_however_often_they_are_tried() -> None:
    """130 bytes alone are 62, 62 and 6 of three chunks."""
    for loss in (0.0, 0.4):
        medium = Elrs(PlainWorld((0, 1), loss=loss))
        for number in range(20):
            medium.offer(AirPacket(0, number, 1, 130, number * 3 * S))
        came = [one for one in fates(medium.run(60 * S)) if one.loss is None]
        assert len(came) > 10
        assert {one.parts for one in came} == {3}
        assert max(one.attempts for one in came) > (30 if loss else 3)


def test_a_way_that_is_longer_than_the_rest_of_a_slot_is_too_long() -> None:
    """493 us are left at 500 Hz: 148 km."""
    for delay_ns, comes in ((492_000, True), (493_000, False)):
        medium = Elrs(PlainWorld((0, 1), delay_ns=delay_ns))
        medium.offer(AirPacket(0, 0, 1, 10, 0))
        assert bool(medium.run(S)) is comes


def test_a_chunk_is_dropped_after_too_many_wrong_confirmations() -> None:
    """The transmitter is deaf to its receiver, which hears it: 41 confirmations, one each 4 ms, then it gives up."""
    medium = Elrs(PlainWorld((0, 1), deaf=((1, 0),)), ElrsSettings(begins_us=0), seed=3)
    for number in range(3):
        medium.offer(AirPacket(1, number, 0, 62, 0))
    (fate,) = medium.run(S)
    assert isinstance(fate, AirFate)
    assert (fate.packet.number, fate.loss, fate.attempts) == (0, Loss.RETRIES, 41)
    assert fate.at_ns == 41 * 4 * MS + 1_507_000


class Blackout(PlainWorld):
    """A world in which for a while nobody hears anybody."""

    def __init__(self, from_ns: int, to_ns: int) -> None:
        super().__init__((0, 1))
        self._dark = range(from_ns, to_ns)

    def survives(
        self, frame: AirFrame, receiver: int, power_mw: float, pieces: Sequence[Piece]
    ) -> tuple[bool, bool]:
        """Nothing that starts in the dark."""
        return frame.started_ns not in self._dark, True


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("dark_s", [2, 3])
def test_a_link_is_lost_after_its_time_and_found_at_the_next_sync(dark_s: int, seed: int) -> None:
    """At 500 Hz a receiver waits 2.5 s, then for sync, which comes on one of 80 frequencies of 8 ms: each 640 ms.

    What enters it meanwhile is lost; a shorter gap loses nothing down. A transmitter that found its link again, after
    0.5 s or more, has forgotten what waited.
    """
    begins_ns, ends_ns = 3 * S, (3 + dark_s) * S
    medium = Elrs(Blackout(begins_ns, ends_ns), seed=seed)
    for number in range(800):
        medium.offer(AirPacket(1, number, 0, 5, number * 10 * MS))
    for number in range(5):
        medium.offer(AirPacket(0, number, 1, 100, begins_ns + 100 * MS))
    found = fates(medium.run(20 * S))
    outages = [one.packet.at_ns for one in found if one.packet.node == 1 and one.loss is Loss.OUTAGE]
    if dark_s == 3:
        assert min(outages) == pytest.approx(begins_ns + 2500 * MS, abs=15 * MS)
        assert ends_ns - 10 * MS <= max(outages) <= ends_ns + 650 * MS
    else:
        assert outages == []
    up = {one.packet.number: one.loss for one in found if one.packet.node == 0}
    assert up == {0: Loss.OUTAGE, **dict.fromkeys(range(1, 5), Loss.OUTAGE)}


class Parted(Blackout):
    """Between its nodes there is a partition as long."""

    def are_apart(self, node: int, other: int, at_ns: int) -> bool:
        """Of the only pair."""
        del node, other
        return at_ns in self._dark


def test_what_a_link_that_a_partition_took_down_loses_is_lost_to_that() -> None:
    """Until the partition is over; while the receiver then waits for sync, it is an outage."""
    begins_ns, ends_ns = 3 * S, 6 * S
    medium = Elrs(Parted(begins_ns, ends_ns), seed=1)
    for number in range(800):
        medium.offer(AirPacket(1, number, 0, 5, number * 10 * MS))
    for number in range(5):
        medium.offer(AirPacket(0, number, 1, 100, begins_ns + 100 * MS))
    lost = [one for one in fates(medium.run(20 * S)) if one.loss is not None]
    assert {one.loss for one in lost if one.packet.node == 0} == {Loss.PARTITIONED}
    down = [one for one in lost if one.packet.node == 1]
    assert {one.loss for one in down} == {Loss.PARTITIONED, Loss.OUTAGE, Loss.QUEUE_FULL}
    for one in (each for each in down if each.loss is not Loss.QUEUE_FULL):
        assert (one.loss is Loss.PARTITIONED) == (one.packet.at_ns < ends_ns)


def test_stubborn_ends_as_the_firmware_has_them() -> None:
    """Numbers 1, 2, then 0 for the last; a repeated first fragment turns the bit back, a repeated second does not."""
    sender, receiver = StubbornSender(127, 40), StubbornReceiver(127)
    sender.load(12)
    assert receiver.take(sender.fragment(5)) is None
    assert receiver.bit
    assert receiver.take(sender.fragment(5)) is None
    assert not receiver.bit
    sender.confirm(receiver.bit)
    assert sender.fragment(5) == Fragment(1, 0, 5)
    receiver.take(sender.fragment(5))
    sender.confirm(receiver.bit)
    for _ in range(3):
        receiver.take(sender.fragment(5))
        assert not receiver.bit
    sender.confirm(receiver.bit)
    assert sender.fragment(5) == Fragment(0, 10, 2)
    parts = receiver.take(sender.fragment(5))
    assert parts is not None
    assert are_whole(parts, 12)
    assert receiver.take(sender.fragment(5)) is None
    sender.confirm(receiver.bit)
    assert sender.is_idle
    assert sender.fragment(5) == NOTHING


def test_a_repetition_of_another_length_damages_a_chunk() -> None:
    """The first fragment came with 5 bytes; the sender, who repeats it with 1 and then is confirmed, goes on at 1."""
    sender, receiver = StubbornSender(127, 40), StubbornReceiver(127)
    sender.load(14)
    for room in (5, 5):
        receiver.take(sender.fragment(room))
        sender.confirm(receiver.bit)
    sender.load(14)
    receiver.take(sender.fragment(5))
    sender.confirm(receiver.bit)
    receiver.take(sender.fragment(5))
    receiver.take(sender.fragment(1))
    sender.confirm(receiver.bit)
    parts = None
    while parts is None:
        parts = receiver.take(sender.fragment(5))
        sender.confirm(receiver.bit)
    assert [(part.first, part.length) for part in parts] == [(0, 5), (5, 5), (6, 5), (11, 3)]
    assert not are_whole(parts, 14)


def test_mistakes_are_said() -> None:
    """With what is wrong."""
    for pairs in (((0, 0),), ((0, 1), (1, 2)), ((0, 9),)):
        with pytest.raises(ValueError, match="in no other pair"):
            Elrs(PlainWorld((0, 1, 2)), ElrsSettings(pairs=pairs))
    with pytest.raises(ValueError, match="packets of 2000 us in slots of 1000 us"):
        ElrsMode(1000, -100.0, 2000, 8, 4, 80, 2500, 3)


def test_frequencies_come_in_another_order_in_each_round_of_256_hops() -> None:
    """As `FHSS.cpp`: 40 frequencies six times, each round from that of sync, each frequency once, then all again."""
    sequence = hop_sequence(40, WordStream(Draws(1), "1", "hops"))
    rounds = [sequence[begin : begin + 40] for begin in range(0, 240, 40)]
    assert len(sequence) == 240
    assert {each[0] for each in rounds} == {20}
    assert all(sorted(each) == list(range(40)) for each in rounds)
    assert len(set(rounds)) == 6


def test_two_pairs_meet_as_often_as_chance_has_it() -> None:
    """Two sequences of 240 hops at each of 240 offsets: 1 of 40 hops in the mean, and hardly ever none at all.

    A round of its own has a share of hops at one place of 1/40 by chance, so that six rounds have none in about
    exp(-6) = 0.25 % of all offsets; of one round for ever it were exp(-1) = 37 %.
    """
    meetings = []
    for seed in range(20):
        one, other = (np.array(hop_sequence(40, WordStream(Draws(seed), name, "hops"))) for name in "ab")
        meetings += [int((one == np.roll(other, offset)).sum()) for offset in range(240)]
    assert np.mean(meetings) == pytest.approx(6.0, rel=0.02)
    assert np.mean(np.array(meetings) == 0) < 0.01


def test_the_first_slot_begins_at_an_instant_of_its_own() -> None:
    """Within two slots, by seed: transmitters of two networks that hear each other do not begin together."""
    begins_us = set()
    for seed in range(8):
        world = Listening()
        medium = Elrs(world, ElrsSettings(LORA_500), seed=seed)
        medium.run(4 * MS)
        begins_us.add(world.first_ns / 1000)
    assert len(begins_us) == 8
    assert max(begins_us) < 2 * LORA_500.interval_us


def test_a_packet_of_which_a_chunk_was_taken_waits_with_what_is_left() -> None:
    medium = Elrs(PlainWorld((0, 1, 2)))
    medium.offer(AirPacket(0, 0, 1, 100, 0))
    medium.run(1 * MS)
    assert medium.queued(0) == (1, 100 - CHUNK_BYTES)
    assert medium.queued(2) == (0, 0), "which has no peer"
