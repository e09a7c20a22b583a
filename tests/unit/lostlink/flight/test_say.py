"""What others wrote does nothing to the terminal, whichever way it is shown."""

from __future__ import annotations

import pytest
from rich.table import Table

from lostlink.flight.shown.console import plain_console
from lostlink.flight.shown.say import say


def test_a_line_has_no_control_characters(capsys: pytest.CaptureFixture[str]) -> None:
    say("a\x1b[2Jb")
    say(ValueError("c\rd"), err=True)
    assert capsys.readouterr() == ("a\\x1b[2Jb\n", "c\\rd\n")


def test_nor_has_what_the_console_shows(capsys: pytest.CaptureFixture[str]) -> None:
    console = plain_console()
    console.print("[near] \x1b[31mred", soft_wrap=True)
    table = Table("name", box=None)
    table.add_row("\x1b[31mred")
    console.print(table)
    assert [line.strip() for line in capsys.readouterr().out.splitlines()] == [
        "[near] \\x1b[31mred",
        "name",
        "\\x1b[31mred",
    ]
