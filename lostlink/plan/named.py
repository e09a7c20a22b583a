"""Many things in one line: the first few, and how many there are besides."""

from __future__ import annotations

from collections.abc import Sequence

NAMED_MAX = 5


def named(things: Sequence[str], between: str = ", ") -> str:
    """The first of ``things``, ``between`` them, and the count of the others."""
    more = f"{between.strip(', ')} and {len(things) - NAMED_MAX} more" if len(things) > NAMED_MAX else ""
    return between.join(things[:NAMED_MAX]) + more
