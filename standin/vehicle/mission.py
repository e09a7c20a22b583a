"""The mission: a list of items as MAVLink carries them; item 0 is home, as in ArduPilot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from standin.vehicle.location import Location

ITEMS_MAX = 700


class Command(IntEnum):
    """MAV_CMD of the items that the stand-in flies."""

    WAYPOINT = 16
    LOITER_TIME = 19
    RETURN_TO_LAUNCH = 20
    LAND = 21
    TAKEOFF = 22
    DO_CHANGE_SPEED = 178


class SpeedKind(IntEnum):
    """SPEED_TYPE of DO_CHANGE_SPEED."""

    AIR = 0
    GROUND = 1
    CLIMB = 2
    DESCENT = 3


SPEED_KINDS = frozenset(SpeedKind)


class MissionKind(IntEnum):
    """MAV_MISSION_TYPE of what can be uploaded. Fences and rally points are kept and given back, and not obeyed."""

    MISSION = 0
    FENCE = 1
    RALLY = 2


COMMANDS: dict[MissionKind, frozenset[int]] = {
    MissionKind.MISSION: frozenset(Command),
    MissionKind.FENCE: frozenset(range(5000, 5005)),  # MAV_CMD_NAV_FENCE_*
    MissionKind.RALLY: frozenset({5100}),  # MAV_CMD_NAV_RALLY_POINT
}
"""What the items of each kind may be."""


class MissionFrame(IntEnum):
    """MAV_FRAME of the items that the stand-in flies."""

    GLOBAL = 0
    MISSION = 2
    GLOBAL_RELATIVE_ALT = 3
    GLOBAL_INT = 5
    GLOBAL_RELATIVE_ALT_INT = 6


RELATIVE_FRAMES = frozenset({MissionFrame.GLOBAL_RELATIVE_ALT, MissionFrame.GLOBAL_RELATIVE_ALT_INT})
POSITION_COMMANDS = frozenset({Command.WAYPOINT, Command.LOITER_TIME, Command.LAND, Command.TAKEOFF})
ALT_STEP_M = 0.01
"""ArduPilot keeps heights in whole centimetres: what is smaller is none."""


@dataclass(frozen=True, slots=True)
class StandinItem:
    """One item: MISSION_ITEM_INT's fields. Latitude and longitude are 1e-7 degrees, the altitude is in m."""

    seq: int
    frame: int
    command: int
    param1: float
    param2: float
    param3: float
    param4: float
    lat_e7: int
    lon_e7: int
    alt_m: float
    autocontinue: int = 1

    @property
    def is_here(self) -> bool:
        """Whether it has no position (0, 0), so that it is where the vehicle is."""
        return self.lat_e7 == 0 and self.lon_e7 == 0

    def alt_amsl_m(self, home: Location) -> float:
        """Return its height above mean sea level."""
        return self.alt_m + (home.alt_amsl_m if self.frame in RELATIVE_FRAMES else 0.0)

    def location(self, home: Location, present: Location) -> Location:
        """Return where to fly: of an item without a position, or without a height (0), the present one is kept.

        ArduCopter: ``ModeAuto::loc_from_cmd``.
        """
        alt_amsl_m = present.alt_amsl_m if abs(self.alt_m) < ALT_STEP_M else self.alt_amsl_m(home)
        if self.is_here:
            return Location(present.lat_deg, present.lon_deg, alt_amsl_m)
        return Location(self.lat_e7 * 1e-7, self.lon_e7 * 1e-7, alt_amsl_m)


def home_item(home: Location) -> StandinItem:
    """Return item 0 of a mission."""
    place = (home.lat_e7, home.lon_e7, home.alt_amsl_m)
    return StandinItem(0, MissionFrame.GLOBAL, Command.WAYPOINT, 0.0, 0.0, 0.0, 0.0, *place)


class Mission:
    """The items stored and the one that is flown."""

    def __init__(self) -> None:
        self._items: list[StandinItem] = []
        self.current = 0
        """Sequence number of the item that is, or will be, flown."""
        self.running = False
        """Whether AUTO flies it."""
        self.complete = False
        """Whether its last item is done."""
        self.jumped = False
        """Whether the ground has chosen another item of a mission that runs."""
        self.revision = 0
        """Rises at each upload and clearing."""

    def __len__(self) -> int:
        return len(self._items)

    def item(self, seq: int) -> StandinItem | None:
        """Return an item, or None if there is none of that number."""
        return self._items[seq] if 0 <= seq < len(self._items) else None

    def next_flown(self, seq: int) -> StandinItem | None:
        """Return the first item from ``seq`` on that does not only set something."""
        while (item := self.item(seq)) is not None and item.command == Command.DO_CHANGE_SPEED:
            seq += 1
        return item

    def replace(self, items: Sequence[StandinItem]) -> None:
        """Store a new mission; as in ArduCopter it is at the number where the one before was."""
        self._items = list(items)
        self.revision += 1

    def clear(self) -> None:
        """Forget it."""
        self.replace([])
        self.current = 0
        self.running = self.complete = False

    def begin(self) -> None:
        """Run from where it was stopped, or from the first item."""
        first = 1 if self.complete else max(self.current, 1)
        self.current = first if self.item(first) else 1
        self.running, self.complete, self.jumped = True, False, False

    def end(self, *, complete: bool) -> None:
        """Stop, at the current item or after the last."""
        self.running = False
        self.complete = self.complete or complete

    def rewind(self) -> None:
        """Go back to the first item, as at disarming."""
        self.current = 1 if self.running else 0

    def set_home(self, home: Location) -> None:
        """Keep item 0 at home."""
        if self._items:
            self._items[0] = home_item(home)

    def set_current(self, seq: int) -> bool:
        """Choose the item to fly, at once if it runs; return False if there is none of that number."""
        if not 0 <= seq < max(len(self._items), 1):
            return False
        self.current = max(seq, 1) if self._items else 0  # home stands for the first item
        self.complete = False
        self.jumped = self.running
        return True
