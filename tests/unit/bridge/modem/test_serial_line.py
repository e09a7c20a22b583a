"""Bytes of ten bit times, by exact fractions."""

from __future__ import annotations

from fractions import Fraction

import pytest

from bridge.modem.serial_line import SerialLine

BYTE_NS = Fraction(10 * 10**9, 57_600)


def test_bytes_follow_each_other_at_the_baud_rate() -> None:
    line = SerialLine(57_600)
    assert line.put(bytes(5760), 7) == 7 + 10**9  # 5760 bytes of ten bits at 57600 bit/s: a second
    for count in (1, 2, 3, 100, 5760):
        at_ns = 7 + int(count * BYTE_NS)
        assert line.arrives_ns(count) == at_ns
        assert line.arrived(at_ns) == count
        assert line.arrived(at_ns - 1) == count - 1
    assert line.arrives_ns(5761) is None


def test_a_burst_waits_for_the_one_before_it() -> None:
    line = SerialLine(9600)
    line.put(bytes(10), 0)
    line.put(bytes(10), 1000)
    line.put(bytes(10), 10**9)
    assert line.arrives_ns(20) == int(20 * Fraction(10**10, 9600))
    assert line.arrives_ns(30) == 10**9 + int(10 * Fraction(10**10, 9600))
    assert line.take(15) == bytes(15)
    assert line.waiting_bytes == 15
    assert line.arrives_ns(5) == int(20 * Fraction(10**10, 9600))
    assert line.arrived(10**9) == 5
    assert line.arrived(0) == 0, "those that were taken out do not count"


def test_how_bytes_are_put_in_changes_no_instant() -> None:
    whole, pieces = SerialLine(57_600), SerialLine(57_600)
    whole.put(bytes(100), 5)
    for begin in range(0, 100, 7):
        pieces.put(bytes(min(7, 100 - begin)), 5 + begin)
    assert [whole.arrives_ns(n) for n in range(1, 101)] == [pieces.arrives_ns(n) for n in range(1, 101)]


def test_without_a_rate_bytes_take_no_time() -> None:
    line = SerialLine(0)
    assert line.put(b"abc", 5) == 5
    assert (line.arrived(4), line.arrived(5), line.arrives_ns(3)) == (0, 3, 5)
    assert line.take(3) == b"abc"


def test_a_negative_rate_is_refused() -> None:
    with pytest.raises(ValueError, match="-1 baud"):
        SerialLine(-1)
