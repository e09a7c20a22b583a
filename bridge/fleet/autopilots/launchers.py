"""The sources of autopilots, by the names that a scenario has for them."""

from __future__ import annotations

from collections.abc import Mapping

from bridge.fleet.autopilots.ardupilot import ArduPilot
from bridge.fleet.autopilots.dirs import NOT_SAID, AutopilotDirs
from bridge.fleet.autopilots.external import External
from bridge.fleet.autopilots.launch_standin import StandIn
from bridge.fleet.autopilots.launcher import Launcher
from bridge.fleet.autopilots.px4 import Px4
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Aircraft, AutopilotName

LAUNCHERS: dict[AutopilotName, type[Launcher]] = {
    "standin": StandIn,
    "ardupilot": ArduPilot,
    "px4": Px4,
    "external": External,
}


class Launchers:
    """The sources of a fleet's autopilots.

    Args:
        scenario: the fleet.
        environment: environment variables, for finding programs.
        dirs: where real autopilots were said to be.
    """

    def __init__(
        self, scenario: Scenario, environment: Mapping[str, str], dirs: AutopilotDirs = NOT_SAID
    ) -> None:
        self._scenario = scenario
        self._by_name = {name: LAUNCHERS[name](environment, dirs) for name in sorted(scenario.autopilots)}

    def of(self, ua: Aircraft) -> Launcher:
        """That of a UA."""
        return self._by_name[self._scenario.autopilot_of(ua)]

    def each(self, *, waits_for_physics: bool) -> list[tuple[Launcher, list[Aircraft]]]:
        """The sources that wait for physics, or those that do not, each with its UA."""
        return [
            (launcher, [ua for ua in self._scenario.ua if self.of(ua) is launcher])
            for launcher in self._by_name.values()
            if launcher.waits_for_physics == waits_for_physics
        ]
