"""When the scenario has radios off."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

from bridge.scenario.model import Scenario


@dataclass(frozen=True, slots=True)
class OutagePlan:
    """Nodes whose radios are off together, from one instant of sim time to another, s; None: to the end of the run."""

    nodes: tuple[str, ...]
    from_s: float
    to_s: float | None

    def line(self) -> str:
        """What is off, for people."""
        who = f"node{'s' * (len(self.nodes) > 1)} {', '.join(self.nodes)}"
        until = "the end" if self.to_s is None else f"{self.to_s:.12g} s"
        return f"{who}: off from {self.from_s:.12g} s to {until}"


def outages_of(scenario: Scenario) -> tuple[OutagePlan, ...]:
    """All of them, the earliest first."""
    nodes: dict[tuple[float, float | None], list[str]] = defaultdict(list)
    for node in scenario.transceivers:
        for outage in node.radio_off:
            nodes[outage.from_s, outage.to_s].append(node.node)
    outages = [OutagePlan(tuple(who), *when) for when, who in nodes.items()]
    return tuple(sorted(outages, key=lambda each: each.from_s))
