"""What a misspelt word may have been meant to be."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

SYNONYMS = {
    "ua": "nodes",
    "uas": "nodes",
    "vehicles": "nodes",
    "drones": "nodes",
    "aircraft": "nodes",
    "rate_hz": "tick_rate_hz",
    "start": "home",
    "preset": "radio",
    "include": "extends",
    "expect": "expectations",
    "model": "airframe",
    "n": "count",
}
"""Words that look like none of ours, and what they stand for elsewhere."""


def meant(word: object, known: Iterable[str]) -> str | None:
    """The known word that is close to ``word``, or begins with it; None if none does."""
    names = list(known)
    text = str(word).lower()
    close = difflib.get_close_matches(text, names, n=1, cutoff=0.6)
    close += [name for name in names if len(text) > 2 and name.startswith(text)]
    if close:
        return close[0]
    return SYNONYMS[text] if SYNONYMS.get(text) in names else None


def near_miss(word: object, known: Iterable[str]) -> str:
    """``; did you mean X?``, if one of the known words is close to ``word``; else nothing."""
    found = meant(word, known)
    return f"; did you mean {found}?" if found else ""
