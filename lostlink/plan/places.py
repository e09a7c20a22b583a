"""Where nodes are when a run begins."""

from __future__ import annotations

from bridge.scenario.nodes import Aircraft, NodeConfig

HEIGHT_M = 2.0
"""Of a ground node or an emitter that has no place."""


def start_ned_m(node: NodeConfig) -> tuple[float, float, float]:
    """The place of a node at first: north, east, down, m; of a UA its home."""
    if isinstance(node, Aircraft):
        return node.home.north_m, node.home.east_m, 0.0
    first = node.track[0] if node.track else node.place
    return (0.0, 0.0, -HEIGHT_M) if first is None else (first.north_m, first.east_m, -first.height_m)
