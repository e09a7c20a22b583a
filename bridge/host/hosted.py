"""The nodes of a process: made from what the scenario says of them, and ended together."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from time import monotonic

from aps.links.called import CalledClient
from bridge.host.hosted_aircraft import HostedAircraft
from bridge.host.hosted_ground import HostedGround
from bridge.host.hosted_node import HostedNode
from bridge.host.node import Outlets
from bridge.run.directory import RunDirectory
from bridge.scenario.nodes import Aircraft, GroundNode
from bridge.timeouts import AGENT_END_S

log = logging.getLogger("host")


def hosted_node(
    run: RunDirectory, node: str, outlets: Outlets, autopilot: CalledClient | None = None
) -> HostedNode:
    """The node with this id, to be entered.

    Args:
        run: the run.
        node: id of a UA or of a ground node.
        outlets: where what it says goes.
        autopilot: of a UA, if it is in this process.
    """
    config = run.scenario.node(node)
    if isinstance(config, Aircraft):
        return HostedAircraft(run, config, outlets, autopilot)
    assert isinstance(config, GroundNode), "emitters have no host"
    return HostedGround(run, config, outlets)


def stop_all(hosted: Sequence[HostedNode]) -> None:
    """End all agents together, and write what is left of every record, whatever an agent does on its way out."""
    runners = [one.runner for one in hosted if one.runner is not None]
    for runner in runners:
        runner.ask_to_stop()
    until = monotonic() + AGENT_END_S
    for runner in runners:
        if not runner.join(until - monotonic()):
            log.warning("the agent of node %s did not end", runner.ua.node)
    for one in hosted:
        one.close()
