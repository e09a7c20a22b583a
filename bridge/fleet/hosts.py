"""Which processes the nodes share: aircraft bridges and agents have hosts, stand-in autopilots processes of theirs."""

from __future__ import annotations

from collections.abc import Sequence

from bridge.scenario.model import Scenario
from fdm.exchange.settings import core_count


def host_groups(scenario: Scenario) -> tuple[tuple[str, ...], ...]:
    """The nodes of each host; ``auto`` gives as many hosts as cores."""
    return _spread(scenario.nodes, scenario.hosts, core_count())


def standin_groups(scenario: Scenario) -> tuple[tuple[str, ...], ...]:
    """The UA of each process of stand-ins; ``auto`` gives half as many processes as cores: physics needs the others."""
    return _spread([ua.node for ua in scenario.ua], scenario.hosts, max(1, core_count() // 2))


def _spread(nodes: Sequence[str], hosts: str | int, auto: int) -> tuple[tuple[str, ...], ...]:
    """Nodes spread evenly over processes, at most one each. No result depends on it."""
    wanted = {"auto": auto, "per-ua": len(nodes)}.get(str(hosts))
    count = max(1, min(len(nodes), int(hosts) if wanted is None else wanted))
    return tuple(tuple(nodes[index::count]) for index in range(count))


def host_of(scenario: Scenario, node: str) -> str:
    """The name of the process that a node runs in."""
    return next(f"host-{i}" for i, nodes in enumerate(host_groups(scenario)) if node in nodes)
