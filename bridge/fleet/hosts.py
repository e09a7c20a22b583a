"""Which processes the nodes share: aircraft bridges and agents have hosts, stand-in autopilots processes of theirs."""

from __future__ import annotations

from collections.abc import Sequence

from bridge.scenario.model import Scenario
from fdm.exchange.settings import core_count

PREFIX = "host-"


def host_groups(scenario: Scenario) -> dict[str, tuple[str, ...]]:
    """The regulated nodes of each host by its name; ``auto`` gives as many hosts as cores.

    Nodes whose agent is ``isolated`` have a host of their own besides.
    """
    alone = [node.node for node in scenario.transceivers if node.agent.isolated]
    nodes = [node for node in scenario.regulated if node not in alone]
    shared = _spread(nodes, scenario.hosts, core_count())
    named = {f"{PREFIX}{index}": group for index, group in enumerate(shared)}
    return named | {f"{PREFIX}of-{node}": (node,) for node in alone}


def standin_groups(scenario: Scenario) -> tuple[tuple[str, ...], ...]:
    """The UA of each process of stand-ins; ``auto`` gives half as many processes as cores: physics needs the others."""
    flown = [ua.node for ua in scenario.ua if scenario.autopilot_of(ua) == "standin"]
    return _spread(flown, scenario.hosts, max(1, core_count() // 2))


def _spread(nodes: Sequence[str], hosts: str | int, auto: int) -> tuple[tuple[str, ...], ...]:
    """Nodes spread evenly over processes, at most one each. No result depends on it."""
    if not nodes:
        return ()
    wanted = {"auto": auto, "per-ua": len(nodes)}.get(str(hosts))
    count = max(1, min(len(nodes), int(hosts) if wanted is None else wanted))
    return tuple(tuple(nodes[index::count]) for index in range(count))
