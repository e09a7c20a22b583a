"""Mistakes that pydantic found in a scenario, as lines for people: place, key, and what would be right."""

from __future__ import annotations

from collections.abc import Iterator

from pydantic import BaseModel, ValidationError

from bridge.scenario.document.written import Path_, Written, WrittenPlace
from sitl_configs.mistakes import mistakes_in

EXAMPLES = {
    "schema": "schema: 1",
    "name": "name: my_flight",
    "duration_s": "duration_s: 300",
    "origin": "origin: {lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690}",
    "radio": "radio: hata-qpsk",
    "nodes": "nodes: [{id: 0, agent: {type: hold, altitude_m: 40}}]",
    "agent": "agent: {type: hold, altitude_m: 40}",
    "type": "type: hold",
    "id": "id: 0",
}
"""What a missing key could be."""


def explained(
    root: Written, error: ValidationError, model: type[BaseModel], below: Path_ = ()
) -> Iterator[str]:
    """One line per mistake.

    Args:
        root: the scenario.
        error: what the validation of a part of it found.
        model: what that part was to be.
        below: where in the scenario the part is.
    """
    told: set[tuple[str, Path_, str]] = set()
    for at, text in mistakes_in(error, model, EXAMPLES):
        path = (*below, *at)
        place = str(_place(root, path))
        key = path[2:] if path[:1] == ("nodes",) else path
        if (place, key, text) not in told:  # nodes of a group share their lines
            told.add((place, key, text))
            yield f"{place}: {root.dotted(path)}: {text}"


def _place(root: Written, path: Path_) -> WrittenPlace:
    """Where a mistake is: of a key that the scenario lacks, where it could be added."""
    found = root.at(path)
    return root.end or root.place if path and found is root else found.place
