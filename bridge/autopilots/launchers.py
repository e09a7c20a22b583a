"""The sources of autopilots, by the names that a scenario has for them."""

from bridge.autopilots.ardupilot import ArduPilot
from bridge.autopilots.external import External
from bridge.autopilots.launch_standin import StandIn
from bridge.autopilots.launcher import Launcher

LAUNCHERS: dict[str, type[Launcher]] = {"standin": StandIn, "ardupilot": ArduPilot, "external": External}
