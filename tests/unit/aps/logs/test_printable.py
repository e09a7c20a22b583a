"""What others wrote does nothing to a terminal."""

from __future__ import annotations

import logging

import pytest

from aps.logs.printable import PrintableForm, printable


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("\x1b[31mred\x1b[0m", r"\x1b[31mred\x1b[0m"),
        ("gone\rhere\x08\x07\0", r"gone\rhere\x08\x07\x00"),
        ("\x9b2J\x7f\x85", r"\x9b2J\x7f\x85"),
        ("\u202eback\u2066\u2028", r"\u202eback\u2066\u2028"),
        ("\u200fa\u061c\ud800", r"\u200fa\u061c\ud800"),
        ("a\tb\nc é ± → 飞 👩\u200d🚀 [near] \\x1b", "a\tb\nc é ± → 飞 👩\u200d🚀 [near] \\x1b"),
    ],
)
def test_control_characters_are_shown_and_nothing_else_is_changed(text: str, shown: str) -> None:
    assert printable(text) == shown


def test_so_is_a_line_of_a_log_with_its_traceback() -> None:
    try:
        raise ValueError("\x1b]0;title\x07")
    except ValueError as error:
        info = (ValueError, error, error.__traceback__)
    record = logging.LogRecord("aps", logging.ERROR, "", 0, "said %s", ("\x1b[2J",), info)
    line, *traceback = PrintableForm("%(name)s: %(message)s").format(record).splitlines()
    assert line == r"aps: said \x1b[2J"
    assert traceback[-1] == r"ValueError: \x1b]0;title\x07"
