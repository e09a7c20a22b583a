import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.vehicle.status_text import StatusText, StatusTextAssembler
from aps.wire.framer import Framer
from tests.unit.aps.vehicle.peer import Bench


def status_text(text, text_id=0, chunk=0, severity=3):
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    (frame,) = Framer().receive(
        bytes(mavlink.MAVLink_statustext_message(severity, text, text_id, chunk).pack(mav))
    )
    return frame


def whole(assembler, *frames, now_ns=0):
    return [text.text for frame in frames for text in assembler.take(frame, now_ns)]


def test_short_text():
    assert StatusTextAssembler().take(status_text(b"PreArm: no GPS"), 0) == [StatusText(3, "PreArm: no GPS")]


def test_chunked_text_is_joined():
    assembler = StatusTextAssembler()
    frames = [status_text(b"a" * 50, 7, 0), status_text(b"b" * 50, 7, 1), status_text(b"end", 7, 2)]
    assert whole(assembler, *frames[:2]) == []
    assert whole(assembler, frames[2]) == ["a" * 50 + "b" * 50 + "end"]
    assert assembler.due_ns is None


@pytest.mark.parametrize("chunks", [1, 2])
def test_a_text_whose_end_does_not_come_is_told_with_the_next_one(chunks):
    assembler = StatusTextAssembler()
    frames = [status_text(b"a" * 50, 7, chunk, severity=2) for chunk in range(chunks)]
    assert whole(assembler, *frames) == []
    told = assembler.take(status_text(b"next", 8, 0), 0)
    assert told == [StatusText(2, "a" * 50 * chunks), StatusText(3, "next")]


def test_a_text_whose_end_does_not_come_is_told_in_time():
    """PX4 sends texts of 50 characters without an end: "Mission rejected: takeoff not first waypoint item\\t"."""
    assembler = StatusTextAssembler()
    assert whole(assembler, status_text(b"a" * 50, 7, 0), now_ns=5_000_000_000) == []
    assert assembler.due_ns == 6_000_000_000
    assert assembler.overdue(5_999_999_999) == []
    assert assembler.overdue(6_000_000_000) == [StatusText(3, "a" * 50)]
    assert (assembler.due_ns, assembler.overdue(9_000_000_000)) == (None, [])


def test_chunks_that_were_lost_are_marked():
    assembler = StatusTextAssembler()
    assert whole(assembler, status_text(b"a" * 50, 7, 0), status_text(b"end", 7, 2)) == [
        "a" * 50 + " ... end"
    ]
    assert whole(assembler, status_text(b"b" * 50, 8, 1), status_text(b"end", 8, 2)) == [
        " ... " + "b" * 50 + "end"
    ]


def test_a_letter_that_is_cut_between_two_chunks_is_whole():
    letters = ("x" + "\N{GREEK SMALL LETTER ALPHA}" * 30).encode()
    told = whole(StatusTextAssembler(), status_text(letters[:50], 7, 0), status_text(letters[50:], 7, 1))
    assert told == [letters.decode()]


def test_undecodable_text():
    assert whole(StatusTextAssembler(), status_text(b"\xff\xfe")) == ["\N{REPLACEMENT CHARACTER}" * 2]


@pytest.mark.parametrize("text", [b"a" * 50, b"a" * 49 + b"\t"])
def test_a_vehicle_tells_a_text_of_50_characters_of_px4(text):
    bench = Bench(mav_autopilot=12)
    bench.vehicle.text_listeners.append((told := []).append)
    began_ns = bench.now_ns
    bench.tell(mavlink.MAVLink_statustext_message(3, text, 7, 0))
    assert told == []
    while not told and bench.now_ns < began_ns + 3e9:
        bench.step()
    assert [one.text for one in told] == [text.decode().rstrip("\t")]
    assert bench.now_ns - began_ns < 1.1e9
