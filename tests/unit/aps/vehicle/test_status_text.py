from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.vehicle.status_text import StatusText, StatusTextAssembler
from aps.wire.framer import Framer


def status_text(text, text_id=0, chunk=0, severity=3):
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    (frame,) = Framer().receive(
        bytes(mavlink.MAVLink_statustext_message(severity, text, text_id, chunk).pack(mav))
    )
    return frame


def test_short_text():
    assert StatusTextAssembler().take(status_text(b"PreArm: no GPS")) == StatusText(3, "PreArm: no GPS")


def test_chunked_text_is_joined():
    assembler = StatusTextAssembler()
    assert assembler.take(status_text(b"a" * 50, 7, 0)) is None
    assert assembler.take(status_text(b"b" * 50, 7, 1)) is None
    assert assembler.take(status_text(b"end", 7, 2)).text == "a" * 50 + "b" * 50 + "end"


def test_text_with_a_lost_end_does_not_leak_into_the_next():
    assembler = StatusTextAssembler()
    assembler.take(status_text(b"a" * 50, 7, 0))
    assert assembler.take(status_text(b"next", 8, 0)).text == "next"


def test_undecodable_text():
    assert StatusTextAssembler().take(status_text(b"\xff\xfe")).text == "\N{REPLACEMENT CHARACTER}" * 2
