"""Which nodes a group has, and what is said of all of them: known before it is expanded."""

from __future__ import annotations

from typing import TypeGuard

from bridge.scenario.document.written import Written
from bridge.scenario.expand.patterns import PATTERNS
from bridge.scenario.expand.words import filled

COUNT = "count"
COUNT_MAX = 1000
PLACES = {"ua": "home", "ground": "place", "emitter": "place"}
"""What is placed, by kind of node."""


def ids_of(node: Written) -> list[str]:
    """The ids of a group's nodes; none of what is no group, or a wrong one."""
    count, node_id = node.get(COUNT), node.get("id")
    if count is None or node_id is None or not is_count(count.content):
        return []
    if is_whole(node_id.content):
        return [str(node_id.content + index) for index in range(count.content)]
    try:
        names = [{"i": index, "n": count.content} for index in range(count.content)]
        return [str(filled(str(node_id.content), each)) for each in names]
    except ValueError:
        return []


def is_of_all(entry: Written) -> bool:
    """Whether an entry with a group's id is about the whole group: it has a count, a pattern, or the id's index."""
    node_id = entry.get("id")
    places = [place for key in PLACES.values() if (place := entry.get(key)) is not None]
    return (
        entry.get(COUNT) is not None
        or any(place.get(pattern) is not None for place in places for pattern in PATTERNS)
        or (node_id is not None and "{" in str(node_id.content))
    )


def is_whole(value: object) -> TypeGuard[int]:
    """Whether it is a whole number."""
    return isinstance(value, int) and not isinstance(value, bool)


def is_count(value: object) -> TypeGuard[int]:
    """Whether a group may have so many nodes."""
    return is_whole(value) and 0 <= value <= COUNT_MAX
