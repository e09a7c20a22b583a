"""Which fields of an AircraftState are sent together, and so are of one age (`msg/AircraftState.msg`)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from bridge.bus.messages.types import AircraftState

GROUPS: Final[Mapping[int, tuple[str, ...]]] = {
    AircraftState.HEARTBEAT: ("mode", "base_mode", "armed"),
    AircraftState.STATUS: ("voltage_v", "ready_to_arm"),
    AircraftState.ATTITUDE: ("euler_rad",),
    AircraftState.POSITION: ("longitude_deg", "latitude_deg", "altitude_amsl_m", "altitude_rel_m"),
    AircraftState.LOCAL_POSITION: ("position_ned_m",),
    AircraftState.VELOCITY: ("velocity_ned_mps",),
    AircraftState.SPEED: ("indicated_airspeed_mps", "groundspeed_mps", "throttle_percent"),
    AircraftState.AIRSPEED: ("airspeed_mps",),
    AircraftState.WIND: ("wind_body_mps",),
    AircraftState.CURRENT: ("current_a",),
    AircraftState.CLOCK: ("flight_time_s",),
}
"""Place in ``age_s`` -> fields."""
_PLACES: Final = {name: place for place, names in GROUPS.items() for name in names}


def age_s(state: AircraftState, field: str) -> float:
    """How old a field is, s: since the autopilot sent it; inf if it never did, nan if the state does not say.

    Raises:
        ValueError: there is no such field, or it is none that the autopilot sends.
    """
    if field not in _PLACES:
        raise ValueError(f"{field!r} is no field with an age: {', '.join(_PLACES)}")
    return state.age_s[_PLACES[field]] if _PLACES[field] < len(state.age_s) else float("nan")
