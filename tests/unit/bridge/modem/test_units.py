"""Where a modem cuts what its host sends."""

from __future__ import annotations

from bridge.modem.units import Unit, UnitCutter
from tests.unit.bridge.modem.frames import frame_of, heartbeat

BYTE_NS = 173_611


def test_frames_of_both_versions_stay_whole() -> None:
    one, two = heartbeat(version=1), heartbeat(version=2)
    cutter = UnitCutter(BYTE_NS)
    assert cutter.feed(one + two + one[:4], 0) == [Unit(one, 1, True), Unit(two, 2, True)]
    assert (cutter.held_bytes, cutter.needs_bytes(b"")) == (4, len(one) - 4)
    assert cutter.feed(one[4:], 1) == [Unit(one, 1, True)]
    assert cutter.gives_up_ns is None


def test_only_a_heartbeat_is_one() -> None:
    assert UnitCutter(0).feed(frame_of(40, 0), 0) == [Unit(frame_of(40, 0), 2, False)]


def test_a_signed_frame_has_its_signature() -> None:
    frame = bytearray(heartbeat())
    frame[2] = 1
    signed = bytes(frame) + bytes(range(13))
    cutter = UnitCutter(BYTE_NS)
    assert cutter.feed(signed[:-1], 0) == []
    assert cutter.needs_bytes(b"") == 1
    assert cutter.feed(signed[-1:], 1) == [Unit(signed, 2, True)]


def test_what_comes_tells_how_many_bytes_are_needed() -> None:
    cutter = UnitCutter(BYTE_NS)
    assert cutter.needs_bytes(b"\xfd") == 3, "a frame's length is known from three bytes on"
    assert cutter.needs_bytes(heartbeat()[:3]) == len(heartbeat())
    assert cutter.needs_bytes(b"abc" + heartbeat()) == 4, (
        "what is no frame goes on with the next start marker"
    )
    assert cutter.needs_bytes(b"x" * 70) == 32
    cutter.feed(b"abc", 0)
    assert cutter.needs_bytes(b"x" * 70) == 29
    assert cutter.needs_bytes(b"") == 1, "the next may be a start marker"


def test_other_bytes_go_as_they_are() -> None:
    cutter = UnitCutter(BYTE_NS)
    assert cutter.feed(b"abc", 1000) == []
    assert cutter.gives_up_ns == 1000 + 2 * BYTE_NS
    assert cutter.feed(heartbeat(), 2000) == [Unit(b"abc"), Unit(heartbeat(), 2, True)]
    assert cutter.feed(b"x" * 70, 3000) == [Unit(b"x" * 32), Unit(b"x" * 32)]
    assert cutter.give_up() == [Unit(b"x" * 6)]


def test_a_frame_that_does_not_end_goes_on_as_it_is() -> None:
    cutter = UnitCutter(BYTE_NS)
    assert cutter.feed(frame_of(200, 0)[:50], 1000) == []
    assert cutter.gives_up_ns == 1000 + 200 * BYTE_NS
    assert cutter.give_up() == [Unit(frame_of(200, 0)[:50])]
    assert cutter.feed(heartbeat(), 10**9) == [Unit(heartbeat(), 2, True)]


def test_hosts_that_pause_in_a_frame_have_20_ms() -> None:
    cutter = UnitCutter(BYTE_NS)
    cutter.feed(heartbeat()[:5], 1000)
    assert cutter.gives_up_ns == 1000 + 20_000_000
