"""Where nodes are when a run begins."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Aircraft, NodeConfig
from channel.checks import FloatArray
from channel.geometry import Path
from channel.link.radio import Radio

HEIGHT_M = 2.0
"""Of a ground node or an emitter that has no place."""
Places = Mapping[str, FloatArray]
"""North, east, down, m, by node."""


def start_ned_m(node: NodeConfig) -> tuple[float, float, float]:
    """The place of a node at first: north, east, down, m; of a UA its home."""
    if isinstance(node, Aircraft):
        return node.home.north_m, node.home.east_m, 0.0
    first = node.track[0] if node.track else node.place
    return (0.0, 0.0, -HEIGHT_M) if first is None else (first.north_m, first.east_m, -first.height_m)


def places_at_start(scenario: Scenario) -> Places:
    """The first places of all nodes, emitters with them."""
    return {node.node: np.array(start_ned_m(node)) for node in scenario.nodes}


def path_to(radio: Radio, node: str, places: Places, *, is_base: bool) -> Path:
    """What arrives at a node from what its radio hears beside packets, as `Radio.noise_dbm` takes it.

    Args:
        radio: of the node, with the emitters of the run.
        node: which receives.
        places: of all nodes.
        is_base: whether it stands on the ground.
    """
    place = places[node][np.newaxis]
    emitters = {each.name: places[each.name] for each in radio.emitters}
    path = radio.paths.of(place, place, np.zeros(1))
    return path._replace(emitters_ned_m=emitters, tx_is_base=is_base, rx_is_base=is_base)
