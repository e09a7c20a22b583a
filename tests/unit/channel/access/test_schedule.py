"""Slots of their own lengths, rates, channels and classes: expected instants and shares are written out."""

from __future__ import annotations

from math import erfc, log10, pi, sqrt

import pytest

from channel.access.air import Hearing
from channel.access.media.schedule import Schedule, Slot
from channel.access.media.tdma import Tdma
from channel.access.packets import AirFate, AirPacket, Loss
from channel.access.queue import QueueLimits, TransmitQueue
from channel.access.reception.leaks import Leaks
from channel.access.timing import BitRate
from channel.access.world import PlainWorld, World
from channel.link.radio import Radio
from channel.network.radio_world import RadioWorld
from channel.presets import radio_from_mapping

MS, S = 1_000_000, 1_000_000_000
KBPS_80 = BitRate(80_000.0)
"""100 bytes take 10 ms."""


def fates(
    slots: tuple[Slot[int], ...],
    packets: list[AirPacket],
    world: World,
    hearing: Hearing | None = None,
    round_ns: int | None = None,
) -> dict[tuple[int, int, int], AirFate]:
    """By sender, number and receiver."""
    schedule = Schedule(slots, round_ns or max(slot.end_ns for slot in slots))
    medium = Tdma(world, KBPS_80, schedule, QueueLimits(0), hearing)
    for packet in packets:
        medium.offer(packet)
    found = [one for one in medium.run(10 * S) if isinstance(one, AirFate)]
    return {(one.packet.node, one.packet.number, one.receiver): one for one in found}


def test_each_slot_has_its_own_length_and_rate() -> None:
    """100 bytes: 10 ms at 80 kb/s, 5 ms at 160, of which 3 go into 18 ms less a guard of 2; a round is 60 ms."""
    slots = (Slot((0,), 0, 20 * MS), Slot((1,), 30 * MS, 18 * MS, 2 * MS, bit_rate_bps=160_000.0))
    packets = [AirPacket(node, number, 1 - node, 100, 0) for node in (0, 1) for number in range(4)]
    found = fates(slots, packets, PlainWorld((0, 1)), round_ns=60 * MS)
    started = {
        node: [found[node, number, 1 - node].started_ns // MS for number in range(4)] for node in (0, 1)
    }
    assert started == {0: [0, 10, 60, 70], 1: [30, 35, 40, 90]}
    assert {fate.ended_ns - fate.started_ns for key, fate in found.items() if key[0] == 1} == {5 * MS}


@pytest.mark.parametrize(
    ("adjacent", "losses"), [((), {None}), ((0.1,), {None}), ((0.1, 0.1), {Loss.COLLIDED})]
)
def test_two_slots_at_once_on_two_channels(adjacent: tuple[float, ...], losses: set[Loss | None]) -> None:
    """Two channels apart; any interference spoils a frame here, and only what the filter leaves of it is any."""
    slots = (
        Slot((0,), 0, 20 * MS, listeners=(1,)),
        Slot((2,), 0, 20 * MS, channel=2, listeners=(3,)),
    )
    packets = [AirPacket(0, 0, 1, 100, 0), AirPacket(2, 0, 3, 100, 0), AirPacket(2, 1, 1, 100, 0)]
    found = fates(slots, packets, PlainWorld(range(4)), Hearing(adjacent=Leaks.of_all(*adjacent)))
    assert (found[0, 0, 1].started_ns, found[2, 0, 3].started_ns) == (0, 0)
    assert {found[0, 0, 1].loss, found[2, 0, 3].loss} == losses
    assert found[2, 1, 1].loss is Loss.NO_LOCK  # node 1 listens on the other channel


def test_two_in_one_slot_disturb_each_other() -> None:
    """As two do that are on one channel; where they are out of reach of each other's receivers they do not."""
    slots = (Slot((0, 2), 0, 20 * MS),)
    packets = [AirPacket(0, 0, 1, 100, 0), AirPacket(2, 0, 3, 100, 0)]
    near = fates(slots, packets, PlainWorld(range(4)))
    far = fates(slots, packets, PlainWorld(range(4), deaf=[(0, 3), (2, 1)]))
    assert {fate.loss for fate in near.values()} == {Loss.COLLIDED}
    assert {fate.loss for fate in far.values()} == {None}


def test_radios_turn_to_the_channels_of_slots_and_back() -> None:
    """Node 0 is heard by all on channel 3, then node 1 on channel 0; a long way into the next slot is lost."""
    slots = (Slot((0,), 0, 10 * MS, channel=3), Slot((1,), 10 * MS, 10 * MS))
    packets = [AirPacket(0, 0, None, 100, 0), AirPacket(1, 0, None, 100, 0)]
    for delay_ns, loss in ((0, None), (1, Loss.NO_LOCK)):
        found = fates(slots, packets, PlainWorld((0, 1, 2), delay_ns=delay_ns))
        assert {key: fate.loss for key, fate in found.items()} == dict.fromkeys(
            [(0, 0, 1), (0, 0, 2), (1, 0, 0), (1, 0, 2)], loss
        )


def test_where_radios_listen() -> None:
    """Of everybody, those that no slot names are on the channel of the one without listeners, and stay there."""
    slots = (
        Slot(("a",), 0, 4, channel=1),
        Slot(("b",), 2, 2, channel=5, listeners=("c",)),
        Slot(("c",), 6, 2, channel=7, listeners=("d",)),
    )
    assert Schedule(slots, 10).tunings("abcd") == [
        (0, {"a": 1, "b": 1, "c": 1, "d": 1}),
        (2, {"a": 1, "b": 5, "c": 5, "d": 1}),
        (4, {}),
        (6, {"c": 7, "d": 7}),
        (8, {}),
    ]


def test_a_slot_of_a_class_takes_its_packets_alone() -> None:
    """Priority 5 has the second slot for itself, and goes first in the other; 7 has no slot of node 1."""
    slots = (
        Slot((0,), 0, 10 * MS),
        Slot((0,), 10 * MS, 10 * MS, priority=5),
        Slot((1,), 20 * MS, 10 * MS, priority=5),
    )
    packets = [AirPacket(0, number, 1, 100, 0, priority) for number, priority in enumerate([0, 0, 5, 5, 5])]
    packets += [AirPacket(1, 0, 0, 100, 0, 7), AirPacket(1, 1, 0, 100, 0, 5)]
    found = fates(slots, packets, PlainWorld((0, 1)))
    assert [found[0, number, 1].started_ns // MS for number in range(5)] == [60, 90, 0, 10, 30]
    assert (found[1, 0, 0].loss, found[1, 1, 0].started_ns) == (Loss.TOO_LONG, 20 * MS)


def test_a_packet_waits_for_a_slot_that_has_room() -> None:
    """200 bytes take 20 ms; in slots of 10 and 20 ms they wait for the second, and 201 bytes fit into none."""
    slots = (Slot((0,), 0, 10 * MS), Slot((0,), 10 * MS, 20 * MS))
    found = fates(slots, [AirPacket(0, 0, 1, 200, 0), AirPacket(0, 1, 1, 201, 0)], PlainWorld((0, 1)))
    assert (found[0, 0, 1].started_ns, found[0, 1, 1].loss) == (10 * MS, Loss.TOO_LONG)


def test_queues_by_class_fill_by_themselves() -> None:
    """Two of each priority; the newest of a key takes the place of one of its own class, or of another."""
    outbox = TransmitQueue(QueueLimits(2, by_class=True))
    packets = [AirPacket(0, number, 1, 10, 0, number % 2) for number in range(6)]
    lost = [loss for packet in packets for loss in outbox.put(packet, 0)]
    assert lost == [(packets[4], Loss.QUEUE_FULL), (packets[5], Loss.QUEUE_FULL)]
    assert (len(outbox), outbox.length_bytes) == (4, 40)
    assert [outbox.take(0, priority)[0] for priority in (0, 0, 0, None)] == [
        packets[0],
        packets[2],
        None,
        packets[1],
    ]


@pytest.mark.parametrize(
    ("slots", "text"),
    [
        ((), "slots: at least one"),
        ((Slot(("a",), 0, MS, MS),), "slots.0: a slot of 0.001 s with a guard of 0.001 s has no room"),
        (
            (Slot(("a",), 9 * MS, 2 * MS),),
            "slots.0: from 0.009 s to 0.011 s is not within the round of 0.01 s",
        ),
        ((Slot(("a",), 0, 2 * MS), Slot(("b",), MS, MS)), "slots.1: .* slots.0: both are on channel 0"),
        ((Slot(("a",), 0, MS), Slot(("a",), 0, MS, channel=1)), "slots.1: .* slots.0: a cannot be in both"),
        (
            (Slot(("a",), 0, MS), Slot(("b",), 0, MS, channel=1, listeners=("a",))),
            "slots.1: .* slots.0: a cannot be in both",
        ),
        ((Slot(("a",), 0, MS), Slot(("b",), 0, MS, channel=1)), "only one of them can be without listeners"),
    ],
)
def test_slots_that_cannot_be(slots: tuple[Slot[str], ...], text: str) -> None:
    """Each by its place in the list."""
    with pytest.raises(ValueError, match=text):
        Schedule(slots, 10 * MS)


def test_a_slot_too_short_for_an_empty_frame_is_refused() -> None:
    """A header of 14 bytes takes 1.4 ms."""
    schedule = Schedule.equal((0, 1), 2 * MS, MS)
    with pytest.raises(
        ValueError, match=r"slots\.0: its 1000000 ns have no room for an empty frame, which takes 1400000"
    ):
        Tdma(PlainWorld((0, 1)), BitRate(80_000.0, header_bytes=14), schedule)


RADIO = {
    "frequency_hz": 915e6,
    "bandwidth_hz": 200e3,
    "bit_rate_bps": 100e3,
    "transmit_power_dbm": 20.0,
    "propagation": {"model": "free-space"},
    "earth_radius_factor": None,
    "noise": {"model": "thermal", "noise_figure_db": 6.0},
}
FAR_M = 93e3


@pytest.mark.parametrize("bit_rate_bps", [None, 50e3, 100e3, 400e3])
def test_errors_are_those_of_the_modulation_at_the_rate_of_the_slot(bit_rate_bps: float | None) -> None:
    """QPSK: a bit is wrong by erfc(sqrt(Eb / N0)) / 2, with Eb / N0 the SNR times bandwidth over bit rate.

    The SNR is that of Friis and of kTB + 6 dB; at 50 kb/s nearly all comes, at 400 nothing.
    """
    config = radio_from_mapping(RADIO | {"error": {"model": "uncoded-awgn", "modulation": "qpsk"}})
    power_db = 20.0 + 20.0 * log10(299_792_458.0 / (4.0 * pi * 915e6 * FAR_M))
    noise_db = 10.0 * log10(1.380649e-23 * 290.0 * 200e3 * 1000.0) + 6.0
    snr = 10.0 ** ((power_db - noise_db) / 10.0)
    bit_error = erfc(sqrt(snr * 200e3 / (bit_rate_bps or 100e3))) / 2.0
    share = (1.0 - bit_error) ** (8 * 100)
    flat = RadioWorld(Radio(config), {0: (0.0, 0.0, -100.0), 1: (FAR_M, 0.0, -100.0)})
    slots = (Slot((0,), 0, 20 * MS, bit_rate_bps=bit_rate_bps),)
    sent = [AirPacket(0, number, 1, 100, number * 20 * MS) for number in range(400)]
    came = sum(fate.loss is None for fate in fates(slots, sent, flat).values())
    assert came / 400 == pytest.approx(share, abs=0.08)
