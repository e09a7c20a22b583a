"""How the parts of a run are joined: in one process or in many."""

from __future__ import annotations

from typing import Literal

from bridge.scenario.model import Scenario

How = Literal["many", "one", "task"]
"""Many processes, one, or a task of the process that asks: that was started with the environment of a run."""


def how_joined(scenario: Scenario) -> How:
    """What a scenario's ``processes`` comes to; ``auto`` is one, unless something asks for processes of its own."""
    if scenario.processes != "auto":
        return scenario.processes
    return "many" if scenario.asks_for_processes else "one"


def has_bus(scenario: Scenario) -> bool:
    """Whether the run has a Zenoh router."""
    return how_joined(scenario) == "many" or scenario.has_bus


def in_words(scenario: Scenario) -> str:
    """How its parts are joined, for people."""
    if how_joined(scenario) == "many":
        return "many processes, joined by Zenoh"
    return f"one process, {'with' if has_bus(scenario) else 'without'} Zenoh beside it"


def calls_standins(scenario: Scenario) -> bool:
    """Whether its autopilots are stand-ins in its own process, without ports."""
    return how_joined(scenario) == "one" and scenario.autopilots == {"standin"}
