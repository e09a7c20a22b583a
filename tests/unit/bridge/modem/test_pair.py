"""Two modems and their radios: rates, buffers, losses and RADIO_STATUS, by arithmetic of its own."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import accumulate

import pytest

from aps.wire.framer import Framer
from bridge.modem.heard import RadioMeter
from bridge.modem.modem import Modem
from bridge.modem.network import ModemNetwork
from bridge.modem.pair import ENDS, ModemPair
from bridge.modem.radio_status import RADIO_STATUS, SikStatus
from bridge.modem.settings import ModemSettings
from bridge.modem.units import UnitCutter
from channel.access.elrs_modes import ELRS_MODES
from channel.access.media.airtime import AirTime
from channel.access.media.elrs import Elrs, ElrsSettings
from channel.access.packets import AirFate
from channel.access.queue import QueueLimits
from channel.access.timing import BitRate
from channel.access.world import PlainWorld
from channel.medium.reception import Fate
from tests.unit.bridge.modem.frames import decoded, frame_of, heartbeat
from tests.unit.bridge.modem.links import MS, RecordingWorld, S, live, plain_cause, sik_pair

SECONDS = 16


def busy(ends: tuple[int, ...], rate: float, seconds: int = SECONDS) -> list[tuple[int, int, bytes]]:
    """Hosts that send frames of 200 bytes at a rate, bytes a second."""
    count = int(seconds * rate / 200)
    return [(int(n * 200 / rate * S), end, frame_of(200, n)) for end in ends for n in range(count)]


@pytest.mark.parametrize(
    ("air_kbps", "baud", "ends", "bytes_per_s"),
    [
        (64, 57_600, (1,), 5760),  # the line: 57600 bit/s, ten bits a byte
        (64, 115_200, (1,), 6345),  # these by the firmware's arithmetic (docs/reference/air.md)
        (64, 57_600, (0, 1), 3240),
        (32, 57_600, (1,), 3119),
        (16, 57_600, (0, 1), 842),
    ],
)
def test_throughput(air_kbps: int, baud: int, ends: tuple[int, ...], bytes_per_s: int) -> None:
    pair = sik_pair(PlainWorld([0, 1]), baud=baud, air_kbps=air_kbps, framing=False)
    out = live(pair, SECONDS * S, busy(ends, 1.1 * baud / 10))
    for end in ends:
        came = [each for each in out[1 - end] if each.at_ns >= S]
        rate = sum(len(each.data) for each in came) / (SECONDS - 1)
        assert rate == pytest.approx(bytes_per_s, rel=0.03)


def test_bytes_that_find_no_room_are_dropped() -> None:
    pair = sik_pair(PlainWorld([0, 1]), duty_cycle_percent=0)  # never on the air
    live(pair, 2 * S, [(0, 1, bytes(5000))])
    assert pair.modems[1].counts.dropped_bytes == 5000 - 1850
    assert pair.waiting_bytes(1) == 1850


def test_a_full_buffer_takes_bytes_as_soon_as_there_is_room() -> None:
    # host bytes accepted, byte by byte, from when frames left: at each byte's arrival 1850 or less may wait
    world = RecordingWorld()
    pair = sik_pair(world, framing=False, air_kbps=16)
    data = b"".join(frame_of(100, n) for n in range(100))
    live(pair, 3 * S, [(0, 1, data)])
    starts = [(frame.started_ns, frame.length_bytes - 9) for frame in world.frames if frame.kind == "data"]
    waits = dropped = 0
    for place in range(len(data)):
        at_ns = (place + 1) * 10 * S // 57_600
        while starts and starts[0][0] <= at_ns:
            waits -= starts.pop(0)[1]
        if waits < 1850:
            waits += 1
        else:
            dropped += 1
    assert dropped > 1000
    assert pair.modems[1].counts.dropped_bytes == dropped


def test_bytes_that_find_no_room_cost_no_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    steps, step = [], ModemNetwork.step

    def counted(network: ModemNetwork, now_ns: int, fates: Iterable[AirFate]) -> None:
        steps.append(now_ns)
        step(network, now_ns, fates)

    monkeypatch.setattr(ModemNetwork, "step", counted)
    pair = sik_pair(PlainWorld([0, 1]), air_kbps=16)
    live(pair, 4 * S, busy(ENDS, 5760, 4))
    dropped_bytes = [pair.modems[end].counts.dropped_bytes for end in ENDS]
    assert min(dropped_bytes) > 15_000
    assert len(steps) < sum(dropped_bytes) / 10


def test_the_buffer_to_the_host_is_cut() -> None:
    modem = Modem(ModemSettings(57_600, 1850, 645), RadioMeter(), lambda: 0)
    modem.deliver(bytes(range(256)) * 4, 0)
    (out,) = modem.outputs(S)
    assert out.data == (bytes(range(256)) * 4)[:645]
    assert out.at_ns == 645 * 10 * S // 57_600
    assert modem.counts.cut_bytes == 1024 - 645
    assert modem.outputs(2 * S) == []
    modem.deliver(b"x", 2 * S)
    assert [each.at_ns for each in modem.outputs(3 * S)] == [2 * S + 10 * S // 57_600]


@pytest.mark.slow
@pytest.mark.parametrize("length", [40, 100, 263])
def test_a_stream_loses_the_frames_that_its_lost_packets_have_a_part_of(length: int) -> None:
    world = RecordingWorld(loss=0.2, seed=3)
    pair = sik_pair(world, framing=False)
    count = 80_000 // length
    sent = [frame_of(length, n) for n in range(count)]
    out = live(pair, 30 * S, [(int(n * length / 4000 * S), 1, frame) for n, frame in enumerate(sent)])
    packets = world.data(1)
    ends = list(accumulate(length_bytes for _, length_bytes, _ in packets))
    begins = [0, *ends[:-1]]
    assert ends[-1] == count * length, "all of it was on the air"
    whole = [
        frame
        for n, frame in enumerate(sent)
        if all(
            came
            for begin, end, (_, _, came) in zip(begins, ends, packets, strict=True)
            if begin < (n + 1) * length and end > n * length
        )
    ]
    assert [each.data for each in out[0]] == whole
    assert pair.modems[1].counts.units_lost == {Fate.CHANNEL_ERASURE: count - len(whole)}
    assert 1.0 - len(whole) / count > 0.2, "frames that are cut are lost more often than packets"


@pytest.mark.slow
def test_framed_packets_lose_whole_frames_at_the_rate_of_packets() -> None:
    world = RecordingWorld(loss=0.2, seed=3)
    pair = sik_pair(world)
    out = live(pair, 60 * S, [(n * 15 * MS, 1, frame_of(40, n)) for n in range(3900)])
    framed = world.data(1)
    assert all(length_bytes % 40 == 0 for _, length_bytes, _ in framed)
    lost = sum(length_bytes // 40 for _, length_bytes, came in framed if not came)
    assert len(out[0]) == 3900 - lost


def statuses(out: list[tuple[int, bytes]]) -> list[tuple[int, object]]:
    return [
        (at_ns, message)
        for at_ns, data in out
        for message in decoded(data)
        if message.get_type() == "RADIO_STATUS"
    ]


def test_a_station_hears_its_own_modem_when_the_other_is_gone() -> None:
    pair = sik_pair(PlainWorld([0, 1], deaf=[(0, 1), (1, 0)]))
    out = live(pair, 30 * S, [(n * S, 0, heartbeat(n, version=1)) for n in range(30)])
    told = statuses(out[0])
    assert out[1] == []
    assert len(told) == 30
    assert [message.get_seq() for _, message in told] == list(range(30))
    assert {(message.remrssi, message.rxerrors, message.fixed) for _, message in told} == {(0, 0, 0)}
    assert {data[0] for _, data in out[0]} == {0xFE}, "in the version of MAVLink that the host speaks"
    for n, (at_ns, _) in enumerate(told):
        # 17 bytes to the modem, at most a round until its window, on the air, 17 bytes back
        least_ns = (17 + 17) * 10 * S // 57_600
        assert n * S + least_ns < at_ns < n * S + 270 * MS


def test_both_ends_are_told_at_the_rate_of_their_own_heartbeats() -> None:
    pair = sik_pair(PlainWorld([0, 1]))
    said = [(n * S // 2, 0, heartbeat(n)) for n in range(20)] + [(n * S, 1, heartbeat(n)) for n in range(10)]
    said += [(n * S // 10, 1, frame_of(60, n)) for n in range(100)]
    out = live(pair, 11 * S, sorted(said, key=lambda each: each[0]))
    assert [len(statuses(out[end])) for end in ENDS] == [20, 10]


def test_a_status_that_found_no_room_comes_as_soon_as_there_is_some() -> None:
    """At 57600 baud: 1000 bytes wait, of which 645 fit; 17 of them have to leave for a RADIO_STATUS of MAVLink 1."""
    modem = Modem(ModemSettings(57_600, 1850, 645, status=SikStatus()), RadioMeter(), lambda: 0)
    (frame,) = UnitCutter(0).feed(heartbeat(version=1), 0)
    modem.deliver(bytes(1000), 0)
    modem.was_on_air(frame)
    modem.tell(0)
    at_ns = modem.acts_ns()
    assert at_ns == 17 * 10 * S // 57_600
    modem.tell(at_ns - 1)
    assert modem.counts.statuses == 0
    modem.tell(at_ns)
    assert modem.counts.statuses == 1


@pytest.mark.parametrize("begin", [3, 28, 36])
def test_a_frame_with_a_status_in_its_middle_is_none_to_the_host(begin: int) -> None:
    """As the firmware does: RADIO_STATUS goes to the host when it is due, in a frame whose rest is still to come."""
    modem = Modem(ModemSettings(57_600, 1850, 645, status=SikStatus()), RadioMeter(), lambda: 0)
    (beat,) = UnitCutter(0).feed(heartbeat(), 0)
    modem.deliver(frame_of(37, 0)[:begin], 0)
    modem.was_on_air(beat)
    modem.tell(0)
    modem.deliver(frame_of(37, 0)[begin:], 0)
    modem.deliver(frame_of(37, 1), 0)
    stream = b"".join(each.data for each in modem.outputs(S))
    assert [frame.raw for frame in Framer().receive(stream) if frame.msg_id != RADIO_STATUS] == [
        frame_of(37, 1)
    ]
    assert (modem.counts.frames_out, modem.counts.statuses, modem.counts.bytes_out) == (1, 1, 2 * 37)


def test_without_framing_there_is_no_status() -> None:
    pair = sik_pair(PlainWorld([0, 1]), framing=False)
    out = live(pair, 5 * S, [(n * S, 0, heartbeat(n)) for n in range(5)])
    assert out[0] == []
    assert len(out[1]) == 5


def test_txbuf_is_what_serial_arithmetic_and_the_air_leave() -> None:
    world = RecordingWorld()
    pair = sik_pair(world, air_kbps=16)
    script, n = [], 0
    for second in range(12):
        script.append((second * S, 1, heartbeat(second)))
        for _ in range(6):
            script.append((second * S + 1000, 1, frame_of(150, n)))
            n += 1
    out = live(pair, 12 * S, script)
    told = [message for _, message in statuses(out[1])]
    on_air = world.data(1)
    sent = [data for _, _, data in script]
    starts = [0, *accumulate(len(data) for data in sent)]
    expected = []
    for ended_ns, _, _ in on_air:
        aired = sum(length for end_ns, length, _ in on_air if end_ns <= ended_ns)
        before = aired - next(length for end_ns, length, _ in on_air if end_ns == ended_ns)
        has_heartbeat = any(
            before <= start < aired and len(data) == 21 for start, data in zip(starts, sent, strict=False)
        )
        if has_heartbeat:
            arrived = 0
            free_ns = 0
            for at_ns, _, data in script:
                begin_ns = max(at_ns, free_ns)
                free_ns = begin_ns + len(data) * 10 * S // 57_600
                arrived += min(len(data), max(0, (ended_ns - begin_ns) * 57_600 // (10 * S)))
            expected.append(100 * ((1850 - (arrived - aired)) // 8) // 231)
    assert pair.modems[1].counts.dropped_bytes == 0
    assert len(told) == len(expected) == 12
    assert min(expected) < 90
    assert [message.txbuf for message in told] == pytest.approx(expected, abs=1)


def test_elrs_tells_the_autopilot_alone_and_carries_what_it_can() -> None:
    from bridge.modem.radio_status import ElrsStatus

    medium = Elrs(PlainWorld([0, 1]), ElrsSettings(ELRS_MODES["900-200"]))
    modems = {0: ModemSettings(460_800, 1024, 512), 1: ModemSettings(460_800, 1024, 512, status=ElrsStatus())}
    pair = ModemPair(medium, modems, {end: RadioMeter() for end in ENDS}, plain_cause)
    out = live(pair, 60 * S, busy((1,), 600.0, 60))
    assert statuses(out[0]) == []
    assert len(statuses(out[1])) == pytest.approx(60 / 0.011, abs=2)
    # user bytes down with sync, docs/reference/air.md
    assert sum(len(each.data) for each in out[0]) / 60 == pytest.approx(466, rel=0.03)


def test_longer_units_are_cut_for_a_medium_of_short_packets() -> None:
    medium = AirTime(PlainWorld([0, 1]), BitRate(100_000, max_length_bytes=100), QueueLimits(0))
    modems = dict.fromkeys(ENDS, ModemSettings(packet_bytes=100))
    pair = ModemPair(medium, modems, {end: RadioMeter() for end in ENDS}, plain_cause)
    out = live(pair, S, [(0, 0, frame_of(263, 0))])
    assert out[1] == [(263 * 8 * S // 100_000, frame_of(263, 0))]


def test_an_instant_that_has_passed_is_refused() -> None:
    pair = sik_pair(PlainWorld([0, 1]))
    pair.advance(5)
    with pytest.raises(ValueError, match="bytes at 4 ns: it is 5 ns already"):
        pair.receive(0, b"x", 4)
