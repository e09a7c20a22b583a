"""Many things in one line: the first few, and how many there are besides."""

from __future__ import annotations

from collections.abc import Sequence

NAMED_MAX = 5


def named(things: Sequence[str], between: str = ", ", most: int = NAMED_MAX) -> str:
    """The first of ``things``, ``most`` of them, ``between`` them, and the count of the others."""
    more = f"{between.strip(', ')} and {len(things) - most} more" if len(things) > most else ""
    return between.join(things[:most]) + more
