"""Home, mission, fence and rally points of one UA as the map draws them: whole numbers in dm, in the fleet's frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from aps.vehicle.missions.items import MissionItem
from aps.wire.dialect import mavlink
from bridge.agents.frames import Frames
from lostlink.view.picture.onboard import Onboard
from lostlink.view.picture.whole import whole

_ABOVE_SEA: Final = 0
"""MAV_FRAME whose heights count from mean sea level; others count from home, or the ground, as level as home."""
_LAST_WAY: Final = int(mavlink.MAV_CMD_NAV_LAST)
"""Commands up to here are flown to, one after the other; those beyond are done on the way."""
_TAKEOFF: Final = (int(mavlink.MAV_CMD_NAV_TAKEOFF), int(mavlink.MAV_CMD_NAV_VTOL_TAKEOFF))
_HOMEWARD: Final = int(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
_RETURN_POINT: Final = int(mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT)
_POLYGONS: Final = {
    int(mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION): True,
    int(mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION): False,
}
_CIRCLES: Final = {
    int(mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION): True,
    int(mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION): False,
}
_MANY: Final = 1e7
"""Neither a radius in metres nor a number of corners: such an item is not drawn."""
Content = dict[str, Any]


class PlanDrawing:
    """Turns what a UA has on board into what its map is sent.

    Args:
        frames: of the fleet.
    """

    def __init__(self, frames: Frames) -> None:
        self._frames = frames

    def content(self, onboard: Onboard | None, *, is_guided: bool) -> Content:
        """All of it; ``is_guided``: whether the UA flies to where it was told to go."""
        if onboard is None:
            return {}
        target = onboard.target if is_guided else None
        return {
            "home": self._home(onboard),
            "target": self._ground(*target) if target else None,
            "items": self._items(onboard),
            "current": onboard.current,
            "fence": self._fence(onboard.items("fence") or ()),
            "rally": [self._place(item, onboard) for item in onboard.items("rally") or () if item.is_placed],
        }

    def _home(self, onboard: Onboard) -> list[int] | None:
        return _dm(self._frames.fleet_from_earth(*onboard.home)) if onboard.home else None

    def _ground(self, lat_deg: float, lon_deg: float) -> list[int]:
        """North and east of a place."""
        return _dm(self._frames.fleet_from_earth(lat_deg, lon_deg, self._frames.origin.alt_amsl_m))[:2]

    def _place(self, item: MissionItem, onboard: Onboard) -> list[int]:
        """North, east and down of an item."""
        lat_deg, lon_deg, height_m = item.params[4:]
        level_m = onboard.home[2] if onboard.home else self._frames.origin.alt_amsl_m
        alt_m = np.nan_to_num(height_m, posinf=0.0, neginf=0.0) + (
            0.0 if item.frame == _ABOVE_SEA else level_m
        )
        return _dm(self._frames.fleet_from_earth(lat_deg, lon_deg, float(alt_m)))

    def _items(self, onboard: Onboard) -> list[Content]:
        """Of the mission, those that are somewhere; a take-off without a place is beside home, as is the return."""
        home, found = self._home(onboard), []
        for number, item in enumerate(onboard.items("mission") or (), onboard.first_item):
            if item.is_placed:
                place = self._place(item, onboard)
                found.append({"number": number, "at": place, "way": item.command <= _LAST_WAY})
            elif home and item.command in (*_TAKEOFF, _HOMEWARD):
                found.append({"number": number, "at": home, "way": True, "beside": True})
        return found

    def _fence(self, items: Sequence[MissionItem]) -> list[Content]:
        found: list[Content] = []
        left = 0
        for item in items:
            if not item.is_placed or (item.command != _RETURN_POINT and not 0.0 <= item.params[0] < _MANY):
                continue
            place = self._ground(*item.params[4:6])
            if item.command in _CIRCLES:
                circle = [*place, round(10.0 * item.params[0])]
                found.append({"inside": _CIRCLES[item.command], "circle": circle})
            elif item.command in _POLYGONS:
                if left == 0 or "polygon" not in found[-1]:
                    left = int(item.params[0])
                    found.append({"inside": _POLYGONS[item.command], "polygon": []})
                found[-1]["polygon"] += place
                left = max(0, left - 1)
            elif item.command == _RETURN_POINT:
                found.append({"back": place})
        return found


def _dm(place_m: Sequence[float]) -> list[int]:
    return whole(np.array(place_m), 10.0)
