"""Circling a point: ArduCopter by setpoints on the circle, planes and PX4 by their own way."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from aps.vehicle.autopilots.autopilot import Circle
from aps.vehicle.autopilots.choice import autopilot_of
from aps.vehicle.commands.plan import CommandPlan
from aps.vehicle.flight.setpoints import Yaw, leg_s, offset_deg, place_of
from aps.vehicle.flight.steps import EARTH_RADIUS_M, checked, horizontal_distance_m
from aps.vehicle.state import VehicleState
from aps.wire.dialect import is_plane

ORBIT_LEAD_S: Final = 0.1
"""How far ahead on the circle the point is that is flown to: what passes until the setpoint is there. (ArduCopter adds
a speed of its own for what is left to the point.)"""
ORBIT_RATE_HZ: Final = 10.0


@dataclass
class _Flown:
    """A circle, and how much of it has been flown."""

    lat_deg: float
    lon_deg: float
    alt_rel_m: float
    radius_m: float
    clockwise: bool
    turned_rad: float = 0.0
    _bearing_rad: float | None = None

    def offset_m(self, state: VehicleState) -> tuple[float, float]:
        """Where the UA is from the centre: north, east."""
        north = math.radians(state.lat_deg - self.lat_deg) * EARTH_RADIUS_M
        east = math.radians((state.lon_deg - self.lon_deg + 180.0) % 360.0 - 180.0)
        return north, east * EARTH_RADIUS_M * math.cos(math.radians(self.lat_deg))

    def look(self, state: VehicleState, within_m: float) -> None:
        """Count the way around the centre, as long as the UA is near the circle."""
        north, east = self.offset_m(state)
        near = abs(math.hypot(north, east) - self.radius_m) <= within_m
        if not near or not math.isfinite(north + east):
            self._bearing_rad = None
            return
        bearing = math.atan2(east, north)
        if self._bearing_rad is not None:
            step = (bearing - self._bearing_rad + math.pi) % math.tau - math.pi
            self.turned_rad += step if self.clockwise else -step
        self._bearing_rad = bearing

    def lead(self, state: VehicleState, speed_mps: float) -> tuple[float, float, float]:
        """Where on the circle the UA is to be in a moment, as north and east of the centre, and its bearing."""
        north, east = self.offset_m(state)
        bearing = math.atan2(east, north) if math.hypot(north, east) > 1.0 else 0.0
        ahead = min(1.0, speed_mps * ORBIT_LEAD_S / self.radius_m)
        bearing += ahead if self.clockwise else -ahead
        return self.radius_m * math.cos(bearing), self.radius_m * math.sin(bearing), bearing


def orbit(
    state: VehicleState,
    lat_deg: float,
    lon_deg: float,
    alt_rel_m: float,
    radius_m: float,
    speed_mps: float = 5.0,
    turns: float = 1.0,
    clockwise: bool = True,
) -> CommandPlan:
    """Circle a point, and go on at the end (a copter stops; a plane circles until it gets another command).

    A copter flies with its nose to the centre: ArduCopter by setpoints on the circle, PX4 by its ORBIT. A plane's own
    circle is used, at its own speed.

    Args:
        state: the UA now.
        lat_deg: latitude of the centre.
        lon_deg: longitude of the centre.
        alt_rel_m: height above home.
        radius_m: of the circle.
        speed_mps: over ground; not for planes.
        turns: how often around, from where the UA meets the circle.
        clockwise: seen from above.
    """
    lat, lon, height_m = place_of(lat_deg, lon_deg, alt_rel_m)
    radius = checked("radius_m", radius_m, 2.0, 10_000.0)
    speed = checked("speed_mps", speed_mps, 0.1, 50.0)
    circle = _Flown(lat, lon, height_m, radius, bool(clockwise))
    full_rad = checked("turns", turns, 0.01, 10_000.0) * math.tau
    plane = is_plane(state.vehicle_type)
    within_m = max(5.0, radius * (0.5 if plane else 0.2))

    def reached(now: VehicleState) -> bool:
        circle.look(now, within_m)
        return circle.turned_rad >= full_rad

    centre = (lat, lon, height_m)
    way = autopilot_of(state.autopilot).orbit(state, Circle(centre, radius, speed, bool(clockwise)))
    way_m = horizontal_distance_m(state, lat, lon) + full_rad * radius
    return CommandPlan(
        "orbit",
        way.steps,
        reached,
        timeout_s=leg_s(way_m),
        remaining_m=lambda _: max(0.0, (full_rad - circle.turned_rad) * radius),
        modes=way.modes,
        needs_armed=True,
        target=True,
        setpoint=_orbit_setpoint(circle, speed) if way.by_setpoints else None,
        setpoint_period_s=1.0 / ORBIT_RATE_HZ,
        lead_s=way.lead_s,
        stop_messages=way.stop_messages,
        rejection_texts=way.rejection_texts,
        interruption_texts=way.interruption_texts,
    )


def _orbit_setpoint(circle: _Flown, speed_mps: float) -> Callable[[VehicleState, float], Any]:
    def setpoint(now: VehicleState, _: float) -> Any:
        north, east, bearing = circle.lead(now, speed_mps)
        sense = speed_mps if circle.clockwise else -speed_mps
        along = (-math.sin(bearing) * sense, math.cos(bearing) * sense, 0.0)
        place = offset_deg(circle.lat_deg, circle.lon_deg, north, east)
        inward = Yaw(math.degrees(bearing + math.pi) % 360.0)
        there = (*place, circle.alt_rel_m)
        return autopilot_of(now.autopilot).global_setpoint(now, there, along, inward)

    return setpoint
