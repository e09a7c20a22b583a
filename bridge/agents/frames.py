"""Where things are for an agent: in the fleet's frame, in its autopilot's own, and on the earth."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from bridge.bus.messages import AircraftState
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Aircraft
from bridge.scenario.resolve.flight import origin_of
from fdm.model.geodesy import GeodeticPosition, geodetic_from_ned, ned_from_geodetic

Place = tuple[float, float, float]
"""North, east, down, m."""


@dataclass(frozen=True, slots=True)
class Frames:
    """Turns places of one frame into those of another.

    The fleet's frame counts from the scenario's ``origin`` and is the same for all nodes: nodes, emitters and the truth
    are in it. An autopilot counts from its home.

    Attributes:
        origin: of the fleet's frame.
        home_ned_m: where the node's own frame begins, in the fleet's.
    """

    origin: GeodeticPosition
    home_ned_m: Place = (0.0, 0.0, 0.0)

    def fleet_from_own(self, own_ned_m: Place) -> Place:
        """In the fleet's frame, of a place as the node's autopilot counts."""
        (north_m, east_m, down_m), home = own_ned_m, self.home_ned_m
        return north_m + home[0], east_m + home[1], down_m + home[2]

    def own_from_fleet(self, fleet_ned_m: Place) -> Place:
        """As the node's autopilot counts, of a place in the fleet's frame."""
        (north_m, east_m, down_m), home = fleet_ned_m, self.home_ned_m
        return north_m - home[0], east_m - home[1], down_m - home[2]

    def fleet_from_earth(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> Place:
        """In the fleet's frame, of a place on the earth."""
        return ned_from_geodetic(self.origin, GeodeticPosition(lat_deg, lon_deg, alt_amsl_m))

    def earth_from_fleet(self, fleet_ned_m: Place) -> GeodeticPosition:
        """On the earth (``lat_deg``, ``lon_deg``, ``alt_amsl_m``), of a place in the fleet's frame."""
        return geodetic_from_ned(self.origin, fleet_ned_m)

    def place_of(self, state: AircraftState) -> Place:
        """Where a state of the node itself is, in the fleet's frame."""
        return self.fleet_from_own(state.position_ned_m.xyz)


def frames_of(scenario: Scenario, node: str) -> Frames:
    """The frames of a node; those on the ground count in the fleet's themselves."""
    config = scenario.node(node)
    home = (config.home.north_m, config.home.east_m, 0.0) if isinstance(config, Aircraft) else (0.0, 0.0, 0.0)
    return Frames(origin_of(scenario.origin), home)


def has_fix(state: AircraftState) -> bool:
    """Whether the autopilot has reported where it is, how it lies and how fast it flies."""
    where = (state.latitude_deg, state.longitude_deg, state.altitude_amsl_m, state.altitude_rel_m)
    return isfinite(
        sum((*where, *state.position_ned_m.xyz, *state.velocity_ned_mps.xyz, *state.euler_rad.xyz))
    )
