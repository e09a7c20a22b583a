"""What the browser's map is sent: whole numbers in JSON, small enough for ten a second.

A snapshot has everything; a frame has what changes: positions (dm, NED), headings (1/1000 rad), winds (cm/s, NED), the
new points of the trail, losses, which nodes' radios are off, and with each new report the probability of delivery of
each link, on the network where it is greatest of late (percent; -1: none). Emitters, estimates and plans: `marks`.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from lostlink.view.picture.fleet_view import FleetView
from lostlink.view.picture.marks import Marks
from lostlink.view.picture.whole import whole


class PictureFrames:
    """Makes the frames of one picture; each is for all viewers.

    Args:
        view: the picture.
    """

    def __init__(self, view: FleetView) -> None:
        self._view = view
        self._marks = Marks(view)
        self.number = 0
        self._begin()

    def _begin(self) -> None:
        self._forgotten = self._view.times_forgotten
        self._trail_points = self._view.trail_points
        self._reports, self._links = -1, 0
        self._marks.begin()

    def begins_anew(self) -> bool:
        """Whether the picture was begun anew since the last call: then every viewer needs a snapshot."""
        if self._forgotten == self._view.times_forgotten:
            return False
        self._begin()
        return True

    def snapshot(self) -> str:
        """All that a new viewer needs; the next frame follows on from it."""
        view = self._view
        content = {
            "type": "snapshot",
            "number": self.number,
            "nodes": [{"id": node.id, "kind": node.kind} for node in view.nodes],
            "trail": [whole(points, 10.0) for points in list(view.trail)[: self._trail_shown]],
            "links": self._pairs(),
            "quality": self._quality(),
            **self._moving(),
            **self._marks.all(),
        }
        return json.dumps(content, separators=(",", ":"))

    @property
    def _trail_shown(self) -> int:
        """Points of the trail that frames have shown by now."""
        return len(self._view.trail) - (self._view.trail_points - self._trail_points)

    def frame(self) -> str:
        """What is new since the last one."""
        view = self._view
        self.number += 1
        new = min(view.trail_points - self._trail_points, len(view.trail))
        self._trail_points = view.trail_points
        content: dict[str, Any] = {
            "type": "frame",
            "number": self.number,
            **self._moving(),
            **self._marks.changes(),
        }
        if new:
            content["trail"] = [whole(points, 10.0) for points in list(view.trail)[-new:]]
        reports = max(links.reports for links in view.links.values())
        if reports != self._reports:
            self._reports = reports
            content["quality"] = self._quality()
            if len(content["quality"]) != self._links:
                self._links = len(content["quality"])
                content["links"] = self._pairs()
        lost = view.fresh_losses()
        if lost:
            content["lost"] = [number for mark in lost for number in mark]
        return json.dumps(content, separators=(",", ":"))

    def _moving(self) -> dict[str, Any]:
        view = self._view
        return {
            "time": view.sim_time_ns / 1e9,
            "position": whole(view.position_ned_m, 10.0),
            "heading": whole(view.heading_rad, 1000.0),
            "wind": whole(view.wind_ned_mps, 100.0),
            "off": sorted(view.radios_off),
        }

    def _pairs(self) -> list[int]:
        tx, rx = self._view.pairs()
        numbers: list[int] = np.stack((tx, rx), axis=1).ravel().tolist()
        return numbers

    def _quality(self) -> list[int]:
        tx, rx = self._view.pairs()
        return whole(self._view.probability()[tx, rx], 100.0, unknown=-1)
