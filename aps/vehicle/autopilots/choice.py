"""Which autopilot a number of a heartbeat means."""

from __future__ import annotations

from typing import Final

from aps.vehicle.autopilots.ardupilot import ArduPilotWays
from aps.vehicle.autopilots.autopilot import AutopilotWays
from aps.vehicle.autopilots.other import OtherAutopilot
from aps.vehicle.autopilots.px4 import Px4Ways
from aps.wire.dialect import ARDUPILOT, PX4

__all__ = ["autopilot_of"]

_OTHER: Final = OtherAutopilot()
_KNOWN: Final[dict[int, AutopilotWays]] = {ARDUPILOT: ArduPilotWays(), PX4: Px4Ways()}


def autopilot_of(number: int) -> AutopilotWays:
    """The autopilot of a MAV_AUTOPILOT."""
    return _KNOWN.get(number, _OTHER)
