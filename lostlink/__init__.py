"""What programs of one's own import: fly a run, read one back, write agents, join a run that goes on."""

from bridge.agents.agent import Agent
from bridge.agents.beside import connect_ua
from bridge.agents.client import UaClient
from bridge.fleet.supervisor import FleetError
from bridge.flight.scripted import RunResult, fly
from bridge.record.reading.run import NoRun, Run, load_run
from bridge.replay.anew.redecide import Redecision, redecide
from bridge.scenario.file import ScenarioError

__all__ = [
    "Agent",
    "FleetError",
    "NoRun",
    "Redecision",
    "Run",
    "RunResult",
    "ScenarioError",
    "UaClient",
    "connect_ua",
    "fly",
    "load_run",
    "redecide",
]
