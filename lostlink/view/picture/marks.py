"""What the map is sent of the mission: emitters, and what agents log as ellipses and lines; only what has changed.

Whole numbers in dm and 1/1000 rad, in the fleet's frame. A frame has none of it while nothing changes.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lostlink.view.picture.fleet_view import FleetView
from lostlink.view.picture.shapes import Ellipse, Line, Shape
from lostlink.view.picture.whole import whole

SHAPES_PER_FRAME = 60
"""More that have changed wait for the next frame."""
Content = dict[str, Any]


class Marks:
    """The part of frames that has the mission.

    Args:
        view: the picture.
    """

    def __init__(self, view: FleetView) -> None:
        self._view = view
        self.begin()

    def begin(self) -> None:
        """Nothing was sent yet."""
        self._shapes_sent = 0
        self._places_sent: list[int] = []

    def all(self) -> Content:
        """Everything, for a snapshot."""
        logged = self._view.logged
        shapes = [self._shape(key, shape) for key, (_, shape) in logged.shapes.items() if shape]
        return {
            "emitters": [emitter.id for emitter in self._view.emitters],
            "emitterPlaces": self._places(),
            "shapes": shapes,
        }

    def changes(self) -> Content:
        """What has changed since the last call."""
        content: Content = {}
        places = self._places()
        if places != self._places_sent:
            content["emitterPlaces"] = self._places_sent = places
        logged = self._view.logged
        if logged.changes > self._shapes_sent:
            new = [item for item in logged.shapes.items() if item[1][0] > self._shapes_sent]
            new = new[:SHAPES_PER_FRAME]
            self._shapes_sent = new[-1][1][0]
            content["shapes"] = [self._shape(key, shape) for key, (_, shape) in new]
        return content

    def _places(self) -> list[int]:
        return whole(self._view.emitter_position_ned_m, 10.0) if self._view.emitters else []

    def _shape(self, key: tuple[str, str], shape: Shape | None) -> Content:
        """Without ``ellipse`` or ``line`` it is drawn no more."""
        node, name = key
        content: Content = {"node": self._view.index[node], "name": name}
        match shape:
            case Ellipse(north_m, east_m, major_m, minor_m, azimuth_rad):
                lengths = whole(np.array([north_m, east_m, major_m, minor_m]), 10.0)
                content["ellipse"] = [*lengths, round(azimuth_rad * 1000)]
            case Line(places_m):
                content["line"] = whole(np.array(places_m), 10.0)
        return content
