"""The registry of flight modes."""

from __future__ import annotations

from bridge.standin.vehicle.flight_modes import FlightMode, Land, Loiter, ReturnToLaunch, Stabilize
from bridge.standin.vehicle.mode_auto import Auto
from bridge.standin.vehicle.mode_guided import Guided

MODES: tuple[type[FlightMode], ...] = (Stabilize, Auto, Guided, Loiter, ReturnToLaunch, Land)
_BY_NUMBER = {int(mode.number): mode for mode in MODES}


def mode_by_number(number: int) -> FlightMode | None:
    """Return a new mode for ArduCopter's custom_mode, or None if the stand-in has no such mode."""
    mode = _BY_NUMBER.get(number)
    return mode() if mode else None
