"""One ground node of a host: an agent at a place, without an aircraft."""

from __future__ import annotations

from bridge.aircraft.ground_body import GroundBody
from bridge.host.hosted_node import HostedNode
from bridge.host.node import Outlets
from bridge.host.node_record import NodeRecord
from bridge.run.directory import RunDirectory
from bridge.scenario.nodes import GroundNode
from bridge.scenario.resolve.ground_track import GroundTrack


class HostedGround(HostedNode):
    """One ground node with an agent."""

    def __init__(self, run: RunDirectory, config: GroundNode, outlets: Outlets) -> None:
        body = GroundBody(config.node, GroundTrack(run.scenario, config))
        super().__init__(run, config, NodeRecord(run, config.node, has_autopilot=False), body, outlets)
