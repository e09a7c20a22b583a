"""What programs of one's own import: fly a run or a study, read one back, write agents, join a running simulation.

Each name is imported when it is first used: an agent that needs `Agent` alone does not load what flies runs.
"""

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.agents.agent import Agent
    from bridge.agents.beside import connect_ua
    from bridge.agents.client import UaClient
    from bridge.agents.commands import (
        CommandFailed,
        CommandInterrupted,
        CommandRefused,
        CommandTimedOut,
        RunOver,
    )
    from bridge.agents.measurements import Measurement
    from bridge.bus.messages.codec import DecodeError
    from bridge.bus.messages.types import AircraftState, DataPackage
    from bridge.bus.reception import Reception
    from bridge.fleet.course import FleetError
    from bridge.scenario.file import ScenarioError
    from fdm.model.geodesy import GeodeticPosition, geodetic_from_ned, ned_from_geodetic
    from lostlink.flight.scripted import RunResult, fly
    from lostlink.reading.run import NoRun, Run, load_run
    from lostlink.redecision.redecide import Redecision, redecide
    from lostlink.study.lanes import DaskLanes, LocalLanes
    from lostlink.study.model import StudyError
    from lostlink.study.scripted import StudyResult, fly_study
    from lostlink.study.study import Standing

__all__ = [
    "Agent",
    "AircraftState",
    "CommandFailed",
    "CommandInterrupted",
    "CommandRefused",
    "CommandTimedOut",
    "DaskLanes",
    "DataPackage",
    "DecodeError",
    "FleetError",
    "GeodeticPosition",
    "LocalLanes",
    "Measurement",
    "NoRun",
    "Reception",
    "Redecision",
    "Run",
    "RunOver",
    "RunResult",
    "ScenarioError",
    "Standing",
    "StudyError",
    "StudyResult",
    "UaClient",
    "connect_ua",
    "fly",
    "fly_study",
    "geodetic_from_ned",
    "load_run",
    "ned_from_geodetic",
    "redecide",
]

_PLACES = {
    "Agent": "bridge.agents.agent",
    "AircraftState": "bridge.bus.messages.types",
    "CommandFailed": "bridge.agents.commands",
    "CommandInterrupted": "bridge.agents.commands",
    "CommandRefused": "bridge.agents.commands",
    "CommandTimedOut": "bridge.agents.commands",
    "DaskLanes": "lostlink.study.lanes",
    "DataPackage": "bridge.bus.messages.types",
    "DecodeError": "bridge.bus.messages.codec",
    "FleetError": "bridge.fleet.course",
    "GeodeticPosition": "fdm.model.geodesy",
    "LocalLanes": "lostlink.study.lanes",
    "Measurement": "bridge.agents.measurements",
    "NoRun": "lostlink.reading.run",
    "Reception": "bridge.bus.reception",
    "Redecision": "lostlink.redecision.redecide",
    "Run": "lostlink.reading.run",
    "RunOver": "bridge.agents.commands",
    "RunResult": "lostlink.flight.scripted",
    "ScenarioError": "bridge.scenario.file",
    "Standing": "lostlink.study.study",
    "StudyError": "lostlink.study.model",
    "StudyResult": "lostlink.study.scripted",
    "UaClient": "bridge.agents.client",
    "connect_ua": "bridge.agents.beside",
    "fly": "lostlink.flight.scripted",
    "fly_study": "lostlink.study.scripted",
    "geodetic_from_ned": "fdm.model.geodesy",
    "load_run": "lostlink.reading.run",
    "ned_from_geodetic": "fdm.model.geodesy",
    "redecide": "lostlink.redecision.redecide",
}


def _refuse_shadows() -> None:
    """Say which file of the user's hides a package that lostlink consists of.

    Raises:
        ImportError: there is one.
    """
    root = Path(__file__).resolve().parents[1]
    for name in ("aps", "bridge", "channel", "fdm", "standin"):
        spec = find_spec(name)
        file = Path(spec.origin).resolve() if spec is not None and spec.origin else None
        if file is not None and not file.is_relative_to(root / name):
            raise ImportError(
                f"{file} hides lostlink's package {name}: rename it, or start Python with -P elsewhere than beside it"
            )


_refuse_shadows()


def __getattr__(name: str) -> object:
    place = _PLACES.get(name)
    if place is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found: object = getattr(import_module(place), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
