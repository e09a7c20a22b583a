"""The terminal, for texts that people, agents and autopilots wrote: brackets and colons in them mean themselves.

Control characters are shown as `printable` gives them.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from rich.console import Console
from rich.text import Text

from aps.logs.printable import printable
from lostlink.flight.exits import OUTPUT_CLOSED


def plain_console(*, stderr: bool = False) -> Console:
    """A console without markup, emoji codes and highlights: `[near]` and `m.py:boom` are shown as they are."""
    return _PlainConsole(stderr=stderr, markup=False, emoji=False, highlight=False)


class _PlainConsole(Console):
    """All texts that it is given, also in cells of tables, come this way."""

    def render_str(self, text: str, **options: Any) -> Text:
        """As rich does it."""
        return super().render_str(printable(text), **options)

    def on_broken_pipe(self) -> None:
        """As rich does it, but for the status: 1 would say that something is other than it should be."""
        with suppress(SystemExit):
            super().on_broken_pipe()
        raise SystemExit(OUTPUT_CLOSED)
