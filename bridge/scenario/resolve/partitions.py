"""From a scenario to the partitions of its nodes."""

from __future__ import annotations

from bridge.scenario.model import Scenario
from channel.medium.stations.partitions import Partition


def partitions_of(scenario: Scenario) -> list[Partition]:
    """When which nodes of a run do not hear each other, on any network."""
    return [Partition(scenario.nodes_apart(each), each.from_ns, each.to_ns) for each in scenario.partitions]
