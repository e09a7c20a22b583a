"""A table on the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rich.table import Table

WIDE: Final = 1000
"""Columns, where no terminal says how many there are: nothing is folded."""


def print_table(table: Table) -> None:
    """Print it to stdout."""
    from lostlink.flight.shown.console import plain_console  # rich takes its time

    console = plain_console()
    if not console.is_terminal:
        console.width = WIDE
    console.print(table)
