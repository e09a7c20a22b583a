"""The terminal, for texts that people, agents and autopilots wrote: brackets and colons in them mean themselves."""

from __future__ import annotations

from rich.console import Console

__all__ = ["plain_console"]


def plain_console(*, stderr: bool = False) -> Console:
    """A console without markup, emoji codes and highlights: `[near]` and `m.py:boom` are shown as they are."""
    return Console(stderr=stderr, markup=False, emoji=False, highlight=False)
