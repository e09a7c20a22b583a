"""Where a ground node or an emitter is at an instant of sim time."""

from __future__ import annotations

import bisect
from typing import NamedTuple

from bridge.scenario.model import Scenario
from bridge.scenario.nodes import EmitterNode, GroundNode, GroundPlace
from bridge.scenario.resolve.flight import origin_of
from fdm.model.geodesy import GeodeticPosition, geodetic_from_ned

Ned = tuple[float, float, float]


class GroundPlaceAt(NamedTuple):
    """A place on the way, in the fleet's frame and on the earth."""

    position_ned_m: Ned
    velocity_ned_mps: Ned
    position: GeodeticPosition


class GroundTrack:
    """Straight from point to point; before the first point and after the last it stands.

    Args:
        scenario: whose origin the points are relative to.
        node: the ground node or emitter.
    """

    def __init__(self, scenario: Scenario, node: GroundNode | EmitterNode) -> None:
        self._origin = origin_of(scenario.origin)
        self._times_ns = [round(point.sim_time_s * 1e9) for point in node.track]
        self._points = [point.position_ned_m for point in node.track] or [
            (node.place or GroundPlace()).position_ned_m
        ]
        self.is_fixed = len(self._points) == 1

    def at(self, sim_time_ns: int) -> GroundPlaceAt:
        """Where it is, and how fast it moves."""
        position, velocity = self._motion_at(sim_time_ns)
        return GroundPlaceAt(position, velocity, geodetic_from_ned(self._origin, position))

    def _motion_at(self, sim_time_ns: int) -> tuple[Ned, Ned]:
        after = bisect.bisect_right(self._times_ns, sim_time_ns)
        if after == 0 or self.is_fixed:
            return self._points[0], (0.0, 0.0, 0.0)
        if after == len(self._points):
            return self._points[-1], (0.0, 0.0, 0.0)
        begin_ns, end_ns = self._times_ns[after - 1 : after + 1]
        duration_s, passed_s = (end_ns - begin_ns) / 1e9, (sim_time_ns - begin_ns) / 1e9
        (n0, e0, d0), (n1, e1, d1) = self._points[after - 1 : after + 1]
        vn, ve, vd = (n1 - n0) / duration_s, (e1 - e0) / duration_s, (d1 - d0) / duration_s
        return (n0 + vn * passed_s, e0 + ve * passed_s, d0 + vd * passed_s), (vn, ve, vd)
