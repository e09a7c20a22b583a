"""What topics are called: as ROS 2 allows, so no part of a name begins with a digit."""

from __future__ import annotations

import re

from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Aircraft

MAP: str = "map"
"""The frame that poses are in: x east, y north, z up, from the fleet's origin (REP 103)."""


def prefixes(scenario: Scenario) -> dict[str, str]:
    """By node id, what its topics and its frame begin with: ``ua_0``, ``ground_gcs``."""
    found: dict[str, str] = {}
    for node in scenario.nodes:
        kind = "ua" if isinstance(node, Aircraft) else "ground"
        name = unique(f"{kind}_{chunk(node.node)}", set(found.values()))
        found[node.node] = name
    return found


def chunk(text: str) -> str:
    """A text as part of a topic's name."""
    return re.sub(r"[^A-Za-z0-9_]", "_", text)


def named_chunk(text: str) -> str:
    """A text as a whole part of a topic's name."""
    name = chunk(text)
    return f"v_{name}" if name[:1].isdigit() else name


def unique(name: str, taken: set[str]) -> str:
    """``name``, with a number behind it if it is taken."""
    found, number = name, 1
    while found in taken:
        number += 1
        found = f"{name}_{number}"
    return found
