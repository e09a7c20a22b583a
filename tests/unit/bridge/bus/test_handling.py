"""How a packet is to be handled, as bytes behind its stamp: what anybody may send there is taken or refused."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.bus.handling import (
    PLAIN,
    Handling,
    HandlingError,
    handling_bytes,
    handling_from_bytes,
    handling_of,
)
from bridge.record.packets import SentPacket, decode_packet, encode_packet

HANDLINGS = st.builds(
    handling_of,
    st.integers(-128, 127),
    st.none() | st.floats(0.0, 1e6),
    st.text(st.characters(codec="utf-8"), max_size=60),
)


@given(HANDLINGS)
def test_what_is_asked_for_comes_back(handling: Handling) -> None:
    assert handling_from_bytes(handling_bytes(handling)) == handling
    packet = SentPacket(3, 4, "main/all/team", b"payload", "", handling)
    assert decode_packet(encode_packet(packet)) == packet


def test_plain_packets_carry_nothing() -> None:
    assert handling_of(0, None, "") is PLAIN
    assert handling_bytes(PLAIN) == b""


@given(st.binary(max_size=300))
def test_any_bytes_are_handled_or_refused(raw: bytes) -> None:
    try:
        handling = handling_from_bytes(raw)
    except HandlingError:
        return
    encode_packet(SentPacket(0, 0, "main/all/team", b"", "", handling))


def test_a_key_that_is_no_text_is_refused() -> None:
    raw = bytearray(handling_bytes(Handling(0, None, "k" * 100)))
    raw[-100:] = b"\xff" * 100
    with pytest.raises(HandlingError, match="no text in UTF-8"):
        handling_from_bytes(bytes(raw))


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ((200, None, ""), "priority=200"),
        ((0, -1.0, ""), "lifetime_s=-1.0"),
        ((0, math.nan, ""), "lifetime_s=nan"),
        ((0, "1", ""), "lifetime_s='1'"),
        ((0, None, "é" * 200), "at most 255 bytes"),
        ((0, None, "a\ud83d"), "in UTF-8"),
    ],
)
def test_what_cannot_be_is_the_callers_mistake(asked: tuple[int, float | None, str], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        handling_of(*asked)
