"""Nodes whose antennas begin below the ground as their radios' propagation has it, and UA that begin high above it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Aircraft, NodeConfig
from channel.config import RadioConfig
from channel.geometry import MIN_HEIGHT_M
from channel.link.radio import Radio
from channel.propagation.terrain import Terrain
from channel.validity import OutsideValidityError
from channel.variant import name_of
from lostlink.plan.start_positions import start_ned_m
from lostlink.reading.named import named

BELOW_M = 2.0
"""Deeper than what grids of heights are off by."""
ABOVE_M = 10.0
"""Of a UA, which stands on the ground at first: higher than that, terrain and origin do not go together."""


def below_ground(scenario: Scenario, on: Mapping[str, Mapping[str, Radio]]) -> Iterator[str]:
    """Warnings: nodes below the ground, and UA above it, where they are at the start or on their tracks.

    Args:
        scenario: what is to be flown.
        on: by network, the radio of each node on it.
    """
    for network, radios in on.items():
        heights_m: dict[str, dict[str, float]] = {}
        for node in scenario.nodes:
            radio = radios.get(node.node)
            config = radio.config if radio else next(iter(radios.values())).config  # emitters have none
            height_m = _lowest_m(node, config)
            if height_m is not None:
                heights_m.setdefault(name_of(config.propagation), {})[node.node] = height_m
        uas = {node.node for node in scenario.ua}
        for law, of_nodes in heights_m.items():
            low = {node: -height_m for node, height_m in of_nodes.items() if height_m < -BELOW_M}
            high = {
                node: height_m for node, height_m in of_nodes.items() if height_m > ABOVE_M and node in uas
            }
            if low:
                counts = (
                    f"antennas there count as {MIN_HEIGHT_M:g} m above it (heights are from the origin's)"
                )
                yield f"radio of network {network}: below the ground of {law}: {_named(low)}; {counts}"
            if high:
                asks = "is the origin's alt_amsl_m as the terrain has it?"
                yield f"radio of network {network}: UA that begin above the ground of {law}: {_named(high)}; {asks}"


def _lowest_m(node: NodeConfig, config: RadioConfig) -> float | None:
    """The least height of a node above the ground, m; None where no ground is, or the law does not know."""
    law = config.propagation
    if not isinstance(law, Terrain) and (law.has_earth or not (law.has_ground or config.earth_radius_factor)):
        return None
    places = np.array([start_ned_m(node)])
    if not isinstance(node, Aircraft) and node.track:
        places = np.array([point.position_ned_m for point in node.track])
    try:
        ground_m = law.height_m(places[:, 0], places[:, 1]) if isinstance(law, Terrain) else 0.0
    except OutsideValidityError:
        return None
    return float(np.min(-places[:, 2] - ground_m))


def _named(heights_m: Mapping[str, float]) -> str:
    worst = sorted(heights_m, key=lambda node: -heights_m[node])
    return named([f"{node} by {heights_m[node]:.0f} m" for node in worst])
