"""SiK radios against the table of their firmware's arithmetic, and against arithmetic written out here."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from statistics import mean, median
from typing import Any

import numpy as np
import pytest

from channel.access.media.sik.medium import Sik
from channel.access.media.sik.stream import ByteStream
from channel.access.media.sik.timing import NOMINAL_TICK_NS, SikSettings, hop_order, sik_timing
from channel.access.packets import AirFate, AirFrame, AirPacket, Loss, Outcome
from channel.access.queue import QueueLimits
from channel.access.settings.base import Locking
from channel.access.settings.sik import SikMedium
from channel.access.world import Arrival, PlainWorld

MS, S = 1_000_000, 1_000_000_000
UNLIMITED = QueueLimits(0)
BEFORE_OWN = ((0, -1),)
"""Node 0's window opens a tick after instant 0."""
# air kb/s, ECC, us per byte, silence ms, window ms, round ms, bytes a second: one side busy, both busy (each)
TABLE = [
    (16, False, 512, 13.7, 130.0, 287.4, 1535, 842),
    (32, False, 272, 7.5, 130.0, 274.9, 3119, 1627),
    (64, False, 144, 4.16, 114.2, 236.8, 6345, 3240),
    (128, False, 80, 2.5, 63.7, 132.5, 11655, 5940),
    (250, False, 48, 1.7, 38.5, 80.3, 21725, 11020),
    (16, True, 1024, 21.9, 130.0, 303.7, 632, 374),
    (64, True, 288, 6.5, 111.6, 236.2, 2846, 1485),
    (128, True, 160, 3.8, 62.3, 132.2, 5283, 2715),
]


def test_the_settings_of_the_page_are_keys_of_a_scenario() -> None:
    page = (Path(__file__).parents[4] / "docs" / "reference" / "air.md").read_text(encoding="utf-8")
    table = page.split("| setting | default |")[1].split("\n\n")[0]
    keys = {
        key for row in re.findall(r"^\| (`.*?) \|", table, re.MULTILINE) for key in re.findall(r"\w+", row)
    }
    assert keys == SikMedium.model_fields.keys() - Locking.model_fields.keys() - {"model", "pairs", "units"}


class Watched(PlainWorld):
    """A world that remembers what was on the air, and in which nothing is heard for a while."""

    off_ns = (0, 0)

    def __init__(self, nodes: Sequence[int], **rest: float) -> None:
        super().__init__(nodes, **rest)  # type: ignore[arg-type]
        self.frames: list[AirFrame] = []

    def reach(self, frame: AirFrame) -> Sequence[Arrival]:
        self.frames.append(frame)
        return [] if self.off_ns[0] <= frame.started_ns < self.off_ns[1] else super().reach(frame)


def busy(medium: Sik, nodes: Sequence[int], length_bytes: int, count: int) -> None:
    """Give nodes so many packets at instant 0."""
    for node in nodes:
        for number in range(count):
            medium.offer(AirPacket(node, number, None, length_bytes, 0))


def fates(outcomes: list[Outcome]) -> list[AirFate]:
    return [one for one in outcomes if isinstance(one, AirFate)]


def bytes_a_second(settings: SikSettings, nodes: Sequence[int], seconds: int = 10) -> float:
    """That node 0 brings over."""
    medium = Sik(PlainWorld((0, 1)), settings, limits=UNLIMITED)
    length_bytes = settings.air_kbps // 2  # less than 0.1 % of what comes over
    busy(medium, nodes, length_bytes, 125 * settings.air_kbps * seconds // length_bytes)
    came = [one for one in fates(medium.run(seconds * S)) if one.packet.node == 0 and one.loss is None]
    return len(came) * length_bytes / seconds


@pytest.mark.parametrize("row", TABLE)
def test_windows(row: tuple[float, ...]) -> None:
    """As the table says, to its digits; a tick is 16 us there."""
    timing = sik_timing(int(row[0]), ecc=bool(row[1]))
    assert timing.byte * 16 == row[2]
    found = [ticks * 0.016 for ticks in (timing.silence, timing.window, timing.round)]
    assert found == pytest.approx(row[3:6], abs=0.051)


@pytest.mark.parametrize("row", [TABLE[0], *(pytest.param(row, marks=pytest.mark.slow) for row in TABLE[1:])])
def test_user_bytes_a_second(row: tuple[float, ...]) -> None:
    """Of one node that is busy alone, and of one of two; a stream of bytes over 10 s, within 1 %."""
    settings = SikSettings(int(row[0]), bool(row[1]), framing=False, phases=BEFORE_OWN)
    assert bytes_a_second(settings, [0]) == pytest.approx(row[6], rel=0.01)
    assert bytes_a_second(settings, [0, 1]) == pytest.approx(row[7], rel=0.01)


@pytest.mark.parametrize("row", TABLE)
def test_what_a_pair_is_said_to_carry_of_long_packets(row: tuple[float, ...]) -> None:
    """Both busy, as the table says, whose 10 s have a part of a round more (1.2 % at 16 kb/s)."""
    settings = SikMedium(air_kbps=int(row[0]), ecc=bool(row[1]))
    assert settings.capacity_bps(500, 0.0) == pytest.approx(8 * 2 * row[7], rel=0.015)


@pytest.mark.parametrize(
    ("medium", "length_bytes", "off"),
    [
        ({}, 50, 0.015),
        ({}, 92, 0.02),
        pytest.param({}, 500, 0.06, marks=pytest.mark.slow),
        ({"ecc": True}, 92, 0.02),
        pytest.param({"lbt": True}, 92, 0.02, marks=pytest.mark.slow),
        pytest.param({"tick": "nominal"}, 200, 0.02, marks=pytest.mark.slow),
        ({"duty_cycle_percent": 10}, 200, 0.06),
        pytest.param({"duty_cycle_percent": 1}, 500, 0.06, marks=pytest.mark.slow),
    ],
)
def test_what_a_pair_is_said_to_carry(medium: dict[str, Any], length_bytes: int, off: float) -> None:
    """Both busy, and one alone, as much as comes over in a minute, with other phases of their windows.

    92 bytes leave half of the windows empty; the firmware closes a window only after its average has passed the duty
    cycle, and lets more over at the start.
    """
    settings = SikMedium.model_validate(medium)
    pair = replace(settings._settings(lambda _: 0), networks=None)
    for senders, said_bps in (
        ([0, 1], settings.capacity_bps(length_bytes, 0.0)),
        ([0], settings.node_capacity_bps(length_bytes)),
    ):
        sik = Sik(PlainWorld((0, 1)), pair, seed=5, limits=UNLIMITED)
        start, seconds = 30, 60
        busy(sik, senders, length_bytes, 7000 * (start + seconds) // length_bytes)
        came = [
            one for one in fates(sik.run((start + seconds) * S)) if one.loss is None and one.at_ns > start * S
        ]
        assert said_bps == pytest.approx(8 * length_bytes * len(came) / seconds, rel=off)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("air_kbps", "least", "most"), [(64, 0.0, 0.035), (128, 0.06, 0.09), (250, 0.06, 0.09)]
)
def test_what_the_fault_of_the_firmware_costs(air_kbps: int, least: float, most: float) -> None:
    """Little up to 96 kb/s, some 8 % from 128 on."""
    faulty, right = (
        bytes_a_second(SikSettings(air_kbps, framing=False, uint8_fault=fault, phases=BEFORE_OWN), [0, 1])
        for fault in (True, False)
    )
    assert least <= 1.0 - faulty / right <= most


def test_the_wait_for_the_own_window() -> None:
    """From any instant, with a busy peer: w^2 / 2 round = 31.7 ms on average, w = 122.6 ms at worst (16 us ticks)."""
    medium = Sik(PlainWorld((0, 1)), SikSettings(tick_ns=NOMINAL_TICK_NS), limits=UNLIMITED)
    busy(medium, [0, 1], 250, 1000)
    waits_ms = []
    for at_ns in range(0, 60 * S, 1_234_567):
        medium.run(at_ns)
        waits_ms.append(medium.until_window_ns(0) / MS)
    assert mean(waits_ms) == pytest.approx(31.7, rel=0.01)
    assert max(waits_ms) == pytest.approx(122.6, rel=0.01)


@pytest.mark.parametrize(("takes_estimate", "ticks"), [(False, 14_800), (True, 14_800 - 2 * (2425 - 2086))])
def test_rounds_are_shorter_where_estimates_are_taken_as_they_are(takes_estimate: bool, ticks: int) -> None:
    """The firmware has 250 B fly 157 + 252 * 9 = 2425 ticks at 64 kb/s; they last 2086: windows open earlier."""
    world = Watched((0, 1))
    settings = SikSettings(tick_ns=NOMINAL_TICK_NS, takes_estimate=takes_estimate, framing=False)
    medium = Sik(world, settings, limits=UNLIMITED)
    busy(medium, [0, 1], 250, 400)
    medium.run(20 * S)
    starts = [frame.started_ns for frame in world.frames if frame.node == 0]
    opened = [b for a, b in pairwise(starts) if b - a > 100 * MS]
    assert median(np.diff(opened)) / 16_000 == pytest.approx(ticks, abs=4)


def test_who_has_nothing_yields_and_tells_its_statistics() -> None:
    """One empty packet in each of its windows, and statistics at most every 0.51 s; the other has both windows."""
    world = Watched((0, 1))
    medium = Sik(world, SikSettings(phases=BEFORE_OWN, framing=False), limits=UNLIMITED)
    busy(medium, [0], 250, 2000)
    medium.run(60 * S)
    of_idle = Counter(frame.kind for frame in world.frames if frame.node == 1)
    told = [frame.started_ns for frame in world.frames if frame.kind == "statistics"]
    assert set(of_idle) == {"yield", "statistics"}
    assert of_idle["yield"] == pytest.approx(60 / (14_800 * 15.673e-6), abs=2)
    assert of_idle["statistics"] == pytest.approx(60 / 0.5136, abs=2)
    assert min(np.diff(told)) > 0.2 * S
    assert {frame.kind for frame in world.frames if frame.node == 0} == {"data"}


def _runs_locked(medium: Sik, until_ns: int) -> bool:
    medium.run(until_ns)
    return medium.is_locked(0)


def test_lock_is_lost_after_41_looks_and_found_within_two_cycles_of_channels() -> None:
    """41 times 0.5136 s and a part of one; then a cycle is 50 half rounds, 5.8 s at 64 kb/s."""
    look_s, cycle_s = 32_769 * 15.673e-6, 50 * 7400 * 15.673e-6
    for seed in range(5):
        world = Watched((0, 1))
        world.off_ns = (10 * S, (32 + seed) * S)
        medium = Sik(world, SikSettings(), seed=seed)
        medium.run(10 * S)
        locked = [at for at in range(10 * S, 60 * S, 20 * MS) if _runs_locked(medium, at)]
        last_ns, found_ns = next((a, b) for a, b in pairwise(locked) if b - a > S)
        assert 41 * look_s - 0.3 <= last_ns / S - 10 <= 42 * look_s + 0.1
        assert 0 < (found_ns - world.off_ns[1]) / S <= 2 * cycle_s + 1.0


def test_radios_that_are_switched_on_find_each_other() -> None:
    """In one or two cycles of 50 channels: 6 or 12 s at 64 kb/s."""
    found_s, losses = [], Counter[Loss | None]()
    for seed in range(20):
        medium = Sik(PlainWorld((0, 1)), SikSettings(locked=False), seed=seed)
        medium.offer(AirPacket(0, 0, None, 50, 0))
        outcomes = medium.run(100 * MS)
        assert not (medium.is_locked(0) and medium.is_locked(1))
        at_ns = 100 * MS
        while not (medium.is_locked(0) and medium.is_locked(1)):
            at_ns += 100 * MS
            outcomes += medium.run(at_ns)
        losses[fates(outcomes)[0].loss] += 1
        found_s.append(at_ns / S)
    assert losses[Loss.NO_LOCK] >= 15
    assert 5.0 < min(found_s) < 6.5
    assert 11.0 < max(found_s) < 12.5


@pytest.mark.parametrize("framing", [True, False])
def test_packets_stay_whole_with_framing(framing: bool) -> None:
    """MAVLINK = 1: each in one frame, if a frame can hold it; else cut where the frame is full."""
    medium = Sik(PlainWorld((0, 1)), SikSettings(framing=framing), limits=UNLIMITED)
    busy(medium, [0], 70, 300)
    frames = {one.attempts for one in fates(medium.run(20 * S))}
    assert frames == ({1} if framing else {1, 2})


@pytest.mark.parametrize(
    ("air_kbps", "length_bytes", "fault", "frames"),
    [(16, 234, True, 1), (16, 236, True, 2), (32, 202, True, 1), (32, 203, True, 2), (32, 237, False, 1)],
)
def test_a_whole_packet_needs_a_window_with_room(
    air_kbps: int, length_bytes: int, fault: bool, frames: int
) -> None:
    """At 32: (8122 - 285) / 17 ticks = 461 B, modulo 256 less 3: 202; at 16: (8122 - 525) / 32 less 3: 234."""
    medium = Sik(PlainWorld((0, 1)), SikSettings(air_kbps, uint8_fault=fault, phases=BEFORE_OWN))
    medium.offer(AirPacket(0, 0, 1, length_bytes, 0))
    assert [(one.loss, one.attempts) for one in fates(medium.run(60 * S))] == [(None, frames)]


@pytest.mark.parametrize("air_kbps", [24, 32, 48])
def test_a_packet_that_finds_no_room_is_cut_in_the_next_window(air_kbps: int) -> None:
    """Windows open with room for 93, 202 and 206 of 225 B: none waits for more than two rounds of 275 ms and itself."""
    medium = Sik(PlainWorld((0, 1)), SikSettings(air_kbps))
    for number in range(60):
        medium.offer(AirPacket(0, number, 1, 225, number * S))
    found = fates(medium.run(61 * S))
    assert [(one.packet.number, one.loss) for one in found] == [(number, None) for number in range(60)]
    assert max(one.at_ns - one.packet.at_ns for one in found) < (2 * 275 + 225 * 8 / air_kbps + 20) * MS
    assert {one.attempts for one in found} <= {1, 2}


@pytest.mark.parametrize(
    ("packets", "looks", "frames"),
    [
        ([245, 245, 100, 120], [(0, 250), (10, 250), (20, 250)], [250, 240, 220]),
        ([200, 60, 70], [(0, 150), (2001, 150), (2010, 250), (2020, 250)], [0, 150, 50, 130]),
        ([245, 200], [(0, 150), (10, 150), (20, 150), (2011, 150), (2012, 250)], [150, 95, 0, 150, 50]),
    ],
)
def test_frames_are_those_of_the_firmware(
    packets: list[int], looks: list[tuple[int, int]], frames: list[int]
) -> None:
    """Bytes that its `packet_get_next`, compiled, returns at ticks and with so much room, MAVLINK = 1, at 64 kb/s."""
    queue = [AirPacket(0, number, None, length_bytes, 0) for number, length_bytes in enumerate(packets)]
    stream = ByteStream(lambda: queue[0] if queue else None, lambda: queue.pop(0), sik_timing().framed_bytes)
    assert [sum(part.length_bytes for part in stream.cut(room, tick)) for tick, room in looks] == frames


def test_without_framing_an_empty_packet_is_a_byte_of_the_stream() -> None:
    queue = [AirPacket(0, number, None, length_bytes, 0) for number, length_bytes in enumerate((20, 0, 30))]
    stream = ByteStream(lambda: queue[0] if queue else None, lambda: queue.pop(0), 0)
    assert [part.length_bytes for part in stream.cut(100, 0)] == [20, 1, 30]


def test_a_packet_that_takes_the_place_of_one_that_was_held_back_is_cut_as_that() -> None:
    """The host has a new state each 0.1 s, more often than a window opens (0.275 s): they come all the same."""
    medium = Sik(PlainWorld((0, 1)), SikSettings(24))
    for number in range(300):
        medium.offer(AirPacket(0, number, 1, 225, number * 100 * MS, key="state"))
    assert Counter(one.loss for one in fates(medium.run(31 * S)))[None] > 40


def test_a_long_packet_is_lost_with_any_of_its_frames() -> None:
    """1000 B in n frames come with 0.9^n."""
    medium = Sik(PlainWorld((0, 1), loss=0.1), SikSettings(), limits=UNLIMITED)
    busy(medium, [0], 1000, 1500)
    found = fates(medium.run(400 * S))
    assert len(found) == 1500
    came = [one for one in found if one.loss is None]
    frames = mean(one.attempts for one in came)
    assert 4 <= frames <= 8
    assert len(came) / len(found) == pytest.approx(0.9**frames, abs=0.05)
    assert {one.loss for one in found} == {None, Loss.NOISE}


def test_it_holds_1850_bytes_of_its_host() -> None:
    """37 packets of 50 B, the 38th is lost."""
    medium = Sik(PlainWorld((0, 1)))
    busy(medium, [0], 50, 40)
    found = fates(medium.run(5 * S))
    assert Counter(one.loss for one in found) == {None: 37, Loss.QUEUE_FULL: 3}


def test_a_newer_packet_replaces_the_older_one_in_a_full_buffer() -> None:
    """Of 1000 B 250 are on the air; 750 + 900 + 150 of 1850 wait: 150 in place of the 150 fit, 250 do not."""
    medium = Sik(PlainWorld((0, 1)), SikSettings(phases=BEFORE_OWN))
    medium.offer(AirPacket(0, 0, 1, 1000, 0))
    medium.offer(AirPacket(0, 1, 1, 900, 10 * MS))
    for number, length_bytes in ((2, 150), (3, 150), (4, 250)):
        medium.offer(AirPacket(0, number, 1, length_bytes, 10 * MS, key="state"))
    found = {one.packet.number: one.loss for one in fates(medium.run(5 * S))}
    assert found == {0: None, 1: None, 2: Loss.REPLACED, 3: None, 4: Loss.QUEUE_FULL}


def test_it_talks_to_its_peer_alone() -> None:
    """What is for all goes to the peer; what is for another node is lost, and a node alone talks to nobody."""
    medium = Sik(PlainWorld(range(5)), SikSettings(networks=((0, 3), (1, 2))))
    for number, (node, to) in enumerate([(0, None), (0, 3), (0, 1), (4, None), (4, 0), (2, 1)]):
        medium.offer(AirPacket(node, number, to, 30, 0))
    found = {(one.packet.number, one.receiver): one.loss for one in fates(medium.run(5 * S))}
    assert found == {
        (0, 3): None,
        (1, 3): None,
        (2, 1): Loss.NO_PEER,
        (4, 0): Loss.NO_PEER,
        (5, 1): None,
    }


@pytest.mark.slow
@pytest.mark.parametrize(("channels", "share"), [(50, 0.02), pytest.param(10, 0.10, marks=pytest.mark.long)])
def test_pairs_disturb_each_other_where_they_meet(channels: int, share: float) -> None:
    """Two networks hop in orders of their own: one half round in so many they are on one channel."""
    shares = []
    for netid in range(26, 34):
        medium = Sik(
            PlainWorld(range(4)), SikSettings(channels=channels, netids=(25, netid)), limits=UNLIMITED
        )
        busy(medium, range(4), 250, 600)
        losses = Counter(one.loss for one in fates(medium.run(30 * S)))
        assert set(losses) <= {None, Loss.COLLIDED}
        shares.append(losses[Loss.COLLIDED] / losses.total())
    assert mean(shares) == pytest.approx(share, rel=0.6)


def test_networks_hop_over_all_channels_in_their_own_order() -> None:
    """A permutation that hangs on the NETID."""
    orders = {hop_order(netid, 50) for netid in range(100)}
    assert len(orders) == 100
    assert all(sorted(order) == list(range(50)) for order in orders)


def test_the_duty_cycle_is_kept_on_average() -> None:
    """10 % of the time by the firmware's estimate of flights, which is 16 % too long for 250 B."""
    world = Watched((0, 1))
    medium = Sik(world, SikSettings(duty_cycle_percent=10, framing=False), limits=UNLIMITED)
    busy(medium, [0, 1], 250, 2000)
    medium.run(300 * S)
    on_air_ns = sum(one.ended_ns - one.started_ns for one in world.frames if one.node == 0)
    assert 0.08 < on_air_ns / (300 * S) < 0.1


def test_who_listens_before_it_talks_waits_5_ms_of_silence() -> None:
    """And a part of 5 ms more where it heard somebody."""

    def pauses(lbt: bool) -> list[int]:
        world = Watched((0, 1))
        medium = Sik(world, SikSettings(lbt=lbt), limits=UNLIMITED)
        busy(medium, [0, 1], 200, 400)
        medium.run(20 * S)
        frames = sorted(world.frames, key=lambda frame: frame.started_ns)
        return [b.started_ns - a.ended_ns for a, b in pairwise(frames)]

    assert min(pauses(lbt=True)) >= 311 * 15_673 > min(pauses(lbt=False))


@pytest.mark.parametrize("locked", [True, False])
@pytest.mark.parametrize("seed", [0, 1, pytest.param(2, marks=pytest.mark.long)])
def test_the_ledger_balances_however_it_is_run(locked: bool, seed: int) -> None:
    """Each packet has one fate per receiver, and the same whether it is run in one go or tick by tick."""
    rng = np.random.default_rng(seed)
    packets = []
    for number, at_ns in enumerate(np.sort(rng.integers(0, 20 * S, 400)).tolist()):
        node, other = rng.choice(5, 2, replace=False).tolist()
        to, length_bytes = (other if rng.random() < 0.5 else None), int(rng.integers(0, 400))
        packets.append(
            AirPacket(node, number, to, length_bytes, at_ns, key="k" if rng.random() < 0.1 else "")
        )

    def run(step_ns: int, seed: int) -> list[Outcome]:
        medium = Sik(PlainWorld(range(5), loss=0.05, delay_ns=500), SikSettings(locked=locked), seed=seed)
        waiting, found = list(packets), []
        for until_ns in range(step_ns, 60 * S + 1, step_ns):
            while waiting and waiting[0].at_ns < until_ns:
                medium.offer(waiting.pop(0))
            found += medium.run(until_ns - 1)
        assert Counter((one.packet, one.receiver) for one in fates(found)) == Counter(
            (packet, to) for packet in packets for to in medium.receivers_of(packet)
        )
        return found

    at_once = run(60 * S, seed)
    assert run(50 * MS, seed) == at_once
    assert run(60 * S, seed + 1) != at_once
    assert all(
        one.packet.at_ns <= one.started_ns < one.ended_ns <= one.at_ns
        for one in fates(at_once)
        if one.loss is None
    )


def test_mistakes_are_said() -> None:
    """With what is wrong, and what is right."""
    with pytest.raises(ValueError, match="air rate 57 kb/s: one of 2, 4, 8"):
        Sik(PlainWorld((0, 1)), SikSettings(57))
    with pytest.raises(ValueError, match="at most once"):
        Sik(PlainWorld((0, 1, 2)), SikSettings(networks=((0, 1), (1, 2))))
    with pytest.raises(ValueError, match="1 NETIDs for 2 networks"):
        Sik(PlainWorld(range(4)), SikSettings(netids=(3,)))
    with pytest.raises(ValueError, match="one of its own for each network"):
        Sik(PlainWorld(range(4)), SikSettings(netids=(3, 3)))
    with pytest.raises(ValueError, match="60 channels: 1 to 50"):
        SikSettings(channels=60)


def test_a_packet_of_which_a_part_was_sent_waits_with_what_is_left() -> None:
    world = Watched((0, 1, 2))
    medium = Sik(world, SikSettings(phases=BEFORE_OWN, networks=((0, 1),)), limits=UNLIMITED)
    busy(medium, [0], 1000, 2)
    medium.run(10 * MS)
    assert len(world.frames) == 1
    assert medium.queued(0) == (2, 2000 - 250)  # 252 bytes with the trailer
    assert medium.queued(2) == (0, 0), "which is on no NETID"
    medium.run(2 * S)
    assert medium.queued(0) == (0, 0)
