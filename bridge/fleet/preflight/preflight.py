"""Whether a run can start, but for its ports (`bridge.fleet.preflight.slots`): seen before anything is started."""

from __future__ import annotations

import os

from bridge.fleet.autopilots.dirs import NOT_SAID, AutopilotDirs
from bridge.fleet.autopilots.launcher import AutopilotError
from bridge.fleet.autopilots.launchers import Launchers
from bridge.fleet.course import FleetError
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.flight import wind_of
from fdm.errors import WindError


def launchers_of(scenario: Scenario, dirs: AutopilotDirs = NOT_SAID) -> Launchers:
    """The sources of the autopilots that the scenario names."""
    return Launchers(scenario, os.environ, dirs)


def preflight(scenario: Scenario, dirs: AutopilotDirs = NOT_SAID) -> None:
    """See, before anything is started, that there is all that the run needs.

    Args:
        scenario: of the run.
        dirs: where real autopilots are, as far as that was said.

    Raises:
        FleetError: if an autopilot or a wind map is missing, or an autopilot cannot be at its slot; the text says what
            to do.
    """
    try:
        wind_of(scenario).build(seed=scenario.seed, ua_id=0)
    except WindError as error:
        raise FleetError(f"wind: {error}") from error
    launchers = launchers_of(scenario, dirs)
    try:
        for ua in scenario.ua:
            launchers.of(ua).check(scenario, ua)
    except AutopilotError as error:
        raise FleetError(str(error)) from error
