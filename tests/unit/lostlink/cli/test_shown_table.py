"""Tables have names as people wrote them, and are not folded where there is no terminal."""

from __future__ import annotations

import pytest
from rich.table import Table

from lostlink.cli.shown_table import print_table


def test_names_are_no_markup(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table("name")
    for name in ("[b]near[/b]", "3:100:7", "x" * 300):
        table.add_row(name)
    print_table(table)
    shown = capsys.readouterr().out
    assert all(f" {name} " in shown for name in ("[b]near[/b]", "3:100:7", "x" * 300))
