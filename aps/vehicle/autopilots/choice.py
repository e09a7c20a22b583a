"""Which flight stack a number of a heartbeat means."""

from __future__ import annotations

from typing import Final

from aps.vehicle.autopilots.ardupilot import ArduPilotStack
from aps.vehicle.autopilots.autopilot import FlightStack
from aps.vehicle.autopilots.px4 import Px4Stack
from aps.wire.dialect import ARDUPILOT, PX4

_OTHER: Final = FlightStack()
_KNOWN: Final[dict[int, FlightStack]] = {ARDUPILOT: ArduPilotStack(), PX4: Px4Stack()}


def autopilot_of(number: int) -> FlightStack:
    """The flight stack of a MAV_AUTOPILOT."""
    return _KNOWN.get(number, _OTHER)
