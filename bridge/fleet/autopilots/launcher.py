"""What every source of autopilots has in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from bridge.fleet.autopilots.dirs import NOT_SAID, AutopilotDirs
from bridge.fleet.children.child import ProcessSpec
from bridge.record.provenance import AutopilotOrigin
from bridge.run.directory import RunDirectory
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Aircraft
from fdm.model.airframe import Airframe
from fdm.model.geodesy import Home


class AutopilotError(RuntimeError):
    """The autopilot cannot be started; the text says what was looked for and what to do."""


@dataclass(frozen=True, slots=True)
class LaunchPlan:
    """All that an autopilot of one UA is started with."""

    run: RunDirectory
    scenario: Scenario
    ua: Aircraft
    airframe: Airframe
    home: Home

    @property
    def home_text(self) -> str:
        """LAT,LON,ALT,YAW as the command lines take it."""
        p = self.home.position
        return f"{p.lat_deg:.9f},{p.lon_deg:.9f},{p.alt_amsl_m:.3f},{self.home.yaw_deg:.3f}"

    @property
    def name(self) -> str:
        """Name of the process."""
        return f"autopilot-{self.ua.node}"


class Launcher(ABC):
    """A source of autopilots.

    Args:
        environment: environment variables, for finding programs.
        dirs: where real autopilots were said to be.

    Attributes:
        waits_for_physics: whether its autopilots may be started before there is physics.
    """

    waits_for_physics = False

    def __init__(self, environment: Mapping[str, str], dirs: AutopilotDirs = NOT_SAID) -> None:
        self.environment = environment
        self.dirs = dirs

    def check(self, scenario: Scenario, ua: Aircraft) -> None:  # noqa: B027 (most have nothing to check)
        """See that an autopilot for this UA can be started.

        Raises:
            AutopilotError: if not.
        """

    @abstractmethod
    def origin(self, ua: Aircraft) -> AutopilotOrigin:
        """What flies a UA, for the record.

        Raises:
            AutopilotError: there is no autopilot for it.
            OSError: its binary cannot be read.
        """

    @abstractmethod
    def processes(self, plans: Sequence[LaunchPlan]) -> Iterable[ProcessSpec]:
        """The processes to start for the UA of a run.

        Raises:
            AutopilotError: if one cannot be started.
        """
