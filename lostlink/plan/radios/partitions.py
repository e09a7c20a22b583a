"""When the scenario has nodes in parts that do not hear each other."""

from __future__ import annotations

from dataclasses import dataclass

from bridge.scenario.model import Scenario


@dataclass(frozen=True, slots=True)
class PartitionPlan:
    """Groups of nodes that do not hear each other, from one instant of sim time to another, s; None: to the end.

    Attributes:
        unlisted: nodes of no group, which hear all.
    """

    groups: tuple[tuple[str, ...], ...]
    unlisted: tuple[str, ...]
    from_s: float
    to_s: float | None

    def line(self) -> str:
        """Who is apart, for people."""
        until = "the end" if self.to_s is None else f"{self.to_s:.12g} s"
        sides = " | ".join(", ".join(group) for group in self.groups)
        rest = f"; {', '.join(self.unlisted)}: on no side, with links to all" if self.unlisted else ""
        return f"{sides}: apart from {self.from_s:.12g} s to {until}{rest}"


def partition_plans(scenario: Scenario) -> tuple[PartitionPlan, ...]:
    """All of them, the earliest first."""
    plans = []
    for each in scenario.partitions:
        groups = scenario.nodes_apart(each)
        listed = {node for group in groups for node in group}
        unlisted = tuple(node for node in scenario.transceiver_ids if node not in listed)
        plans.append(PartitionPlan(groups, unlisted, each.from_s, each.to_s))
    return tuple(sorted(plans, key=lambda each: each.from_s))
