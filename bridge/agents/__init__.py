"""Agents: what runs on board beside the autopilot, sees only its own node, and talks over the radio.

A scenario names one per UA; `agent_class` finds it. Write your own by subclassing `Agent` (type ``own``).
"""

from bridge.agents.agent import Agent
from bridge.agents.beside import connect_ua
from bridge.agents.client import UaClient
from bridge.agents.commands import CommandFailed, CommandInterrupted, CommandRefused, CommandTimedOut, RunOver
from bridge.agents.measurements import Measurement
from bridge.agents.own import load_class
from bridge.agents.shipped.hold import Hold
from bridge.agents.shipped.out_and_back import OutAndBack
from bridge.agents.shipped.still import Still
from bridge.bus.reception import Reception
from bridge.scenario.agents import AgentConfig, OwnAgent
from sitl_configs.own_code import OwnCodeError

AGENTS: dict[str, type[Agent]] = {"hold": Hold, "out_and_back": OutAndBack, "still": Still}


def agent_class(config: AgentConfig, node: str = "") -> type[Agent]:
    """The class of the agent that a scenario asks for, for a node with this id.

    Raises:
        OwnCodeError: if an agent of type ``own`` cannot be found.
    """
    if isinstance(config, OwnAgent):
        return load_class(config.place, config.class_name, node)
    return AGENTS[config.type]


__all__ = [
    "AGENTS",
    "Agent",
    "CommandFailed",
    "CommandInterrupted",
    "CommandRefused",
    "CommandTimedOut",
    "Hold",
    "Measurement",
    "OutAndBack",
    "OwnCodeError",
    "Reception",
    "RunOver",
    "Still",
    "UaClient",
    "agent_class",
    "connect_ua",
]
