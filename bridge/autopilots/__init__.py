"""Where the autopilot of a UA comes from: real ArduPilot, our stand-in, or something that runs already.

Nothing but this package knows which it is: what it starts, or finds, speaks JSON over UDP to the flight dynamics
and MAVLink over TCP to APS.
"""

from bridge.autopilots.ardupilot import ArduPilot
from bridge.autopilots.external import External
from bridge.autopilots.launch_standin import StandIn
from bridge.autopilots.launcher import AutopilotError, Launcher, LaunchPlan

LAUNCHERS: dict[str, type[Launcher]] = {"standin": StandIn, "ardupilot": ArduPilot, "external": External}

__all__ = ["LAUNCHERS", "ArduPilot", "AutopilotError", "External", "LaunchPlan", "Launcher", "StandIn"]
