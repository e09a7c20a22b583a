"""The sources of autopilots, by the names that a scenario has for them."""

from bridge.fleet.autopilots.ardupilot import ArduPilot
from bridge.fleet.autopilots.external import External
from bridge.fleet.autopilots.launch_standin import StandIn
from bridge.fleet.autopilots.launcher import Launcher

LAUNCHERS: dict[str, type[Launcher]] = {"standin": StandIn, "ardupilot": ArduPilot, "external": External}
