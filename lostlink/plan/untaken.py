"""Parameters that no autopilot takes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

from bridge.scenario.model import Scenario
from lostlink.reading.named import named


def untaken(scenario: Scenario) -> Iterator[str]:
    """A line where stand-ins, which have none, are given parameters of autopilots."""
    own: dict[str, list[str]] = defaultdict(list)
    for ua in scenario.ua:
        if ua.parameters and scenario.autopilot_of(ua) == "standin":
            own[", ".join(ua.parameters)].append(ua.node)
    for names, nodes in own.items():
        yield f"UA {named(nodes)}: stand-ins take no parameters ({names}); real autopilots do"
    if scenario.parameters and scenario.autopilots == {"standin"}:
        yield f"stand-ins take no parameters ({', '.join(scenario.parameters)}); real autopilots do"
