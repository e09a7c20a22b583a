"""Agents: what runs on board beside the autopilot, sees only its own node, and talks over the radio.

A scenario names one per UA; `AGENTS` knows them by name. Write your own by subclassing `Agent`.
"""

from bridge.agents.agent import Agent
from bridge.agents.hold import Hold
from bridge.agents.out_and_back import OutAndBack
from bridge.agents.still import Still
from bridge.scenario import Scenario

AGENTS: dict[str, type[Agent]] = {"hold": Hold, "out_and_back": OutAndBack, "still": Still}


def nodes_with_a_task(scenario: Scenario) -> frozenset[str]:
    """Nodes whose agents have an end of their own, which the run waits for."""
    return frozenset(ua.node for ua in scenario.ua if not AGENTS[ua.agent.type].open_ended)


__all__ = ["AGENTS", "Agent", "Hold", "OutAndBack", "Still", "nodes_with_a_task"]
