"""Which host process a node's aircraft bridge and agent run in."""

from __future__ import annotations

from bridge.scenario.model import Scenario
from fdm.exchange.settings import core_count


def host_groups(scenario: Scenario) -> tuple[tuple[str, ...], ...]:
    """The nodes of each host, spread evenly. No result depends on it.

    ``per-ua``: a host for each node. A number: so many hosts, but no more than nodes. ``auto``: as many as cores.
    """
    nodes = scenario.nodes
    wanted = {"auto": core_count(), "per-ua": len(nodes)}.get(str(scenario.hosts))
    count = max(1, min(len(nodes), int(scenario.hosts) if wanted is None else wanted))
    return tuple(nodes[index::count] for index in range(count))


def host_of(scenario: Scenario, node: str) -> str:
    """The name of the process that a node runs in."""
    return next(f"host-{i}" for i, nodes in enumerate(host_groups(scenario)) if node in nodes)
