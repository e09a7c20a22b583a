"""Modems take any bytes in any pieces at any instants: nothing crashes, and valid frames that follow come through."""

from __future__ import annotations

from hypothesis import example, given, settings
from hypothesis import strategies as st

from bridge.modem.modem import HostBytes
from bridge.modem.pair import ENDS
from bridge.modem.units import UnitCutter
from channel.access.world import PlainWorld
from tests.unit.bridge.modem.frames import frame_of, heartbeat
from tests.unit.bridge.modem.links import MS, S, live, sik_pair

BYTE_NS = 173_611
PAUSE_NS = 100 * MS
"""Longer than any frame waits for its end: 280 bytes at 57600 bit/s."""
STARTS = st.sampled_from([b"\xfd", b"\xfe", b"\xfd\xff", b"\xfe\x09", b"\xfd\x09\x00\x00", heartbeat(3)[:9]])
GARBAGE = st.lists(st.one_of(STARTS, st.binary(max_size=60)), max_size=12).map(b"".join)
FRAMES = st.integers(24, 225).map(lambda length: frame_of(length, length))


@given(GARBAGE, st.lists(st.integers(1, 40), min_size=1, max_size=40))
def test_the_cutter_keeps_every_byte_in_its_place(garbage: bytes, sizes: list[int]) -> None:
    whole, pieces = UnitCutter(BYTE_NS), UnitCutter(BYTE_NS)
    units = [*whole.feed(garbage, 0), *whole.give_up()] if garbage else []
    assert b"".join(unit.data for unit in units) == garbage
    out, begin, n = b"", 0, 0
    while begin < len(garbage):
        size = sizes[n % len(sizes)]
        assert pieces.needs_bytes(garbage[begin : begin + size]) >= 1
        out += b"".join(unit.data for unit in pieces.feed(garbage[begin : begin + size], n))
        begin, n = begin + size, n + 1
    assert out + b"".join(unit.data for unit in pieces.give_up()) == garbage


@given(GARBAGE, st.integers(1, 40), st.integers(1, 60))
@example(b"\0\0\xfd", 3, 1)
def test_no_unit_is_complete_before_the_bytes_that_it_needs(garbage: bytes, size: int, ahead: int) -> None:
    cutter, place = UnitCutter(BYTE_NS), 0
    while place < len(garbage):
        count = min(cutter.needs_bytes(garbage[place : place + ahead]) - 1, size)
        if count and place + count <= len(garbage):
            assert cutter.feed(garbage[place : place + count], 0) == []
            place += count
        cutter.feed(garbage[place : place + 1], 0)
        place += 1


@settings(max_examples=40)
@given(GARBAGE, st.lists(FRAMES, min_size=1, max_size=5))
@example(b"\xfd\xff", [heartbeat(1)])
def test_frames_after_garbage_and_a_pause_come_through(garbage: bytes, frames: list[bytes]) -> None:
    pair = sik_pair(PlainWorld([0, 1]))
    pauses_ns = len(garbage) * BYTE_NS + PAUSE_NS
    said = [(0, 0, garbage), (pauses_ns, 0, b"".join(frames))]
    out = live(pair, pauses_ns + 5 * S, said)
    stream = b"".join(each.data for each in out[1])
    dropped = pair.modems[0].counts.dropped_bytes + pair.modems[1].counts.cut_bytes
    if not dropped:
        assert stream == garbage + b"".join(frames)
    assert [each.data for each in out[1]][-len(frames) :] == frames


def played(script: list[tuple[int, int, bytes]], until_ns: int, step_ns: int) -> list[list[HostBytes]]:
    out = live(sik_pair(PlainWorld([0, 1], loss=0.1), air_kbps=16), until_ns, script, step_ns)
    return [out[end] for end in ENDS]


@settings(max_examples=25)
@given(
    st.lists(
        st.tuples(
            st.integers(0, 2 * S),
            st.sampled_from(ENDS),
            st.one_of(GARBAGE, FRAMES, FRAMES.map(lambda frame: 9 * frame), st.just(heartbeat(version=1))),
        ),
        max_size=20,
    ),
    st.integers(2 * MS, 3 * S),
)
def test_what_comes_out_does_not_hang_on_when_it_is_asked_for(
    said: list[tuple[int, int, bytes]], step_ns: int
) -> None:
    script = sorted(said, key=lambda each: each[0])
    assert played(script, 4 * S, step_ns) == played(script, 4 * S, 4 * S)


@settings(max_examples=25)
@given(st.lists(FRAMES, min_size=1, max_size=30), st.lists(st.integers(1, 90), min_size=1, max_size=10))
def test_how_bytes_are_brought_changes_nothing(frames: list[bytes], sizes: list[int]) -> None:
    data = b"".join(frames)
    pieces, begin, n = [], 0, 0
    while begin < len(data):
        size = sizes[n % len(sizes)]
        # a piece comes before the line has sent those before it
        pieces.append((begin * BYTE_NS // 2, 1, data[begin : begin + size]))
        begin, n = begin + size, n + 1
    assert played(pieces, 4 * S, S) == played([(0, 1, data)], 4 * S, S)
