"""Which host process a node's aircraft bridge and agent run in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bridge.scenario.model import Scenario
from fdm.exchange.settings import core_count

PREFIX = "host-"


def host_groups(scenario: Scenario) -> dict[str, tuple[str, ...]]:
    """The regulated nodes of each host by its name, spread evenly. No result depends on it.

    ``per-ua``: a host for each node. A number: so many hosts, but no more than nodes. ``auto``: as many as cores.
    Nodes whose agent is ``isolated`` have a host of their own besides.
    """
    alone = [
        node.node for node in scenario.nodes if node.is_regulated and getattr(node.agent, "isolated", False)
    ]
    nodes = [node for node in scenario.regulated if node not in alone]
    wanted = {"auto": core_count(), "per-ua": len(nodes)}.get(str(scenario.hosts))
    count = max(1, min(len(nodes), int(scenario.hosts) if wanted is None else wanted))
    shared = {f"{PREFIX}{index}": tuple(nodes[index::count]) for index in range(count)} if nodes else {}
    return shared | {f"{PREFIX}of-{node}": (node,) for node in alone}


def host_of(groups: Mapping[str, Sequence[str]], node: str) -> str:
    """The name of the process that a node runs in."""
    return next(name for name, nodes in groups.items() if node in nodes)
