"""One item of a mission, fence or list of rally points, as people write it and as MAVLink carries it.

Home is no item here: ArduPilot keeps it as item 0 of a mission, which the transfers add and take off
(``first_seq``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from aps.vehicle.autopilots.choice import autopilot_of
from aps.wire.dialect import AUTOPILOT_COMPID, enum_value, has_location, mavlink

KINDS: Final = {
    "mission": int(mavlink.MAV_MISSION_TYPE_MISSION),
    "fence": int(mavlink.MAV_MISSION_TYPE_FENCE),
    "rally": int(mavlink.MAV_MISSION_TYPE_RALLY),
}
"""What can be transferred -> MAV_MISSION_TYPE."""
MAX_ITEMS: Final = 0xFFFE
_GLOBAL: Final = frozenset({0, 3, 5, 6, 10, 11})
"""MAV_FRAMEs whose x and y are a latitude and a longitude."""
_TO_INT: Final = {5: 0, 6: 3, 11: 10}
"""The _INT twins of MAV_FRAMEs, which mean the same in a MISSION_ITEM_INT."""
_LOCAL: Final = frozenset({1, 4, 7, 8, 9, 12, 20, 21})
"""MAV_FRAMEs in metres."""
DEGREES: Final = 1e7
TENTHS_OF_MM: Final = 1e4
NOT_GIVEN: Final = (1 << 31) - 1
"""INT32_MAX as MISSION_ITEM_INT's x or y: none is given (common.xml)."""
_NONE_GIVEN: Final = frozenset({NOT_GIVEN, -(1 << 31)})
"""QGroundControl sends INT32_MIN for the NaN of its plans, and PX4 takes it likewise (PX4-Autopilot #28079)."""
BY_COMMAND: Final[Any] = None
"""In place of a MAV_FRAME: the usual one for the command."""
_RELATIVE: Final = int(mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT)
_MISSION: Final = int(mavlink.MAV_FRAME_MISSION)
_WITH_HEIGHT: Final = frozenset(
    {int(mavlink.MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT), int(mavlink.MAV_CMD_CONDITION_CHANGE_ALT)}
)
"""Commands without a position, but with a height, which ArduPilot takes for one above the sea in MAV_FRAME_MISSION."""
_FLOAT32_MAX: Final = (2.0 - 2.0**-23) * 2.0**127
"""What the four bytes of a parameter can hold."""


@dataclass(frozen=True, slots=True)
class MissionItem:
    """One item.

    Attributes:
        command: MAV_CMD.
        params: its seven parameters, as the MAVLink guide numbers them from 1. Of commands with a position the fifth
            and sixth are latitude and longitude, degrees (metres in a local frame), the seventh is the height, m. NaN:
            not given.
        frame: MAV_FRAME; 3 (GLOBAL_RELATIVE_ALT): heights count from home. By itself 3 for commands with a position or
            a height, 2 (MISSION) for the others, which PX4 takes in no other (mavlink_mission.cpp).
        autocontinue: whether the autopilot goes on by itself afterwards.

    Raises:
        ValueError: a number is none, or out of range.
    """

    command: int
    params: tuple[float, float, float, float, float, float, float]
    frame: int = BY_COMMAND
    autocontinue: bool = True

    def __post_init__(self) -> None:
        if self.frame is BY_COMMAND:
            is_somewhere = self.command in _WITH_HEIGHT or has_location(self.command)
            object.__setattr__(self, "frame", _RELATIVE if is_somewhere else _MISSION)
        if not 0 <= self.command <= 0xFFFF or not 0 <= self.frame <= 0xFF:
            raise ValueError(f"command {self.command} and frame {self.frame} must be in 0..65535 and 0..255")
        if len(self.params) != 7:
            raise ValueError(f"an item has 7 parameters, not {len(self.params)}")
        object.__setattr__(self, "params", tuple(_as_float(value) for value in self.params))
        if any(abs(value) > _FLOAT32_MAX for value in self.params):
            raise ValueError(
                f"params {self.params} must be finite and less than 3.4e38, or NaN where nothing is given"
            )
        if self.is_global and not (abs(self._or_0(4)) <= 90.0 and abs(self._or_0(5)) <= 180.0):
            raise ValueError(f"{self.params[4]}, {self.params[5]} is no latitude and longitude")
        if round(max(abs(self._or_0(4)), abs(self._or_0(5))) * self._scale) >= NOT_GIVEN:
            raise ValueError(f"{self.params[4]}, {self.params[5]} is more than MAVLink can carry")

    @classmethod
    def waypoint(cls, lat_deg: float, lon_deg: float, alt_rel_m: float, hold_s: float = 0.0) -> MissionItem:
        """Fly to a point, height above home."""
        return cls(int(mavlink.MAV_CMD_NAV_WAYPOINT), (hold_s, 0.0, 0.0, 0.0, lat_deg, lon_deg, alt_rel_m))

    @classmethod
    def from_json(cls, item: Any) -> MissionItem:
        """From ``{"command": 16 or "NAV_WAYPOINT", "params": [7 numbers or null], "frame": 3, "autocontinue": true}``.

        Raises:
            ValueError: it is something else.
        """
        if isinstance(item, MissionItem):
            return item
        if not isinstance(item, Mapping) or not {"command", "params"} <= item.keys():
            raise ValueError(f"an item has 'command' and 'params', unlike {item!r}")
        extra = item.keys() - {"command", "params", "frame", "autocontinue"}
        if extra:
            raise ValueError(f"key {min(extra, key=str)!r} of an item is unknown")
        params = item["params"]
        if not isinstance(params, Sequence) or isinstance(params, str) or len(params) != 7:
            raise ValueError(f"params must be a list of 7 numbers, not {params!r}")
        return cls(
            _whole("MAV_CMD", item["command"]),
            tuple(_number(value) for value in params),  # type: ignore[arg-type]
            _whole("MAV_FRAME", item["frame"]) if "frame" in item else BY_COMMAND,
            _truth(item.get("autocontinue", True)),
        )

    def to_json(self) -> dict[str, Any]:
        """As ``from_json`` reads it."""
        params = [None if math.isnan(value) else value for value in self.params]
        return {
            "command": self.command,
            "params": params,
            "frame": self.frame,
            "autocontinue": self.autocontinue,
        }

    @property
    def is_global(self) -> bool:
        """Whether it has a latitude and a longitude."""
        return self.frame in _GLOBAL and has_location(self.command)

    @property
    def is_placed(self) -> bool:
        """Whether it is at a place on the earth: 0, 0 is for ArduPilot where it is when the item's turn comes."""
        lat_deg, lon_deg = self.params[4:6]
        return self.is_global and math.isfinite(lat_deg + lon_deg) and (lat_deg, lon_deg) != (0.0, 0.0)

    @property
    def lacks_place(self) -> bool:
        """Whether it should have a latitude and a longitude, and one of them is not given."""
        return self.is_global and any(math.isnan(value) for value in self.params[4:6])

    @property
    def _scale(self) -> float:
        if self.is_global:
            return DEGREES
        return TENTHS_OF_MM if self.frame in _LOCAL and has_location(self.command) else 1.0

    def jumping_to(self, number: float) -> MissionItem:
        """The same DO_JUMP to another item."""
        return replace(self, params=(float(number), *self.params[1:]))

    def _or_0(self, index: int) -> float:
        value = self.params[index]
        return 0.0 if math.isnan(value) else value

    def _whole(self, index: int, none: int) -> int:
        value = self.params[index]
        return none if math.isnan(value) else round(value * self._scale)

    def to_message(
        self, sysid: int, seq: int, kind: int, *, current: bool = False, zero_is_here: bool = False
    ) -> Any:
        """MISSION_ITEM_INT to the autopilot of a system; ``zero_is_here``: a place that is not given is 0, 0 to it.

        To others it is INT32_MAX, which PX4 takes for a latitude of 214.7 (mavlink_mission.cpp of early 2025): where
        ``lacks_place`` the item is for ArduPilot alone.
        """
        none = 0 if zero_is_here else NOT_GIVEN
        return mavlink.MAVLink_mission_item_int_message(
            sysid,
            AUTOPILOT_COMPID,
            seq,
            self.frame,
            self.command,
            int(current),
            int(self.autocontinue),
            *self.params[:4],
            self._whole(4, none),
            self._whole(5, none),
            self.params[6],
            kind,
        )

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> MissionItem:
        """From the fields of a MISSION_ITEM_INT.

        Raises:
            ValueError: they make no sense.
        """
        command, frame = int(fields["command"]), _TO_INT.get(int(fields["frame"]), int(fields["frame"]))
        scale = 1.0
        if has_location(command):
            scale = DEGREES if frame in _GLOBAL else TENTHS_OF_MM if frame in _LOCAL else 1.0
        first = [float(fields[f"param{n}"]) for n in range(1, 5)]
        place = (math.nan if fields[name] in _NONE_GIVEN else fields[name] / scale for name in ("x", "y"))
        params: Any = (*first, *place, float(fields["z"]))
        return cls(command, params, frame, bool(fields["autocontinue"]))


def _whole(enum: str, value: Any) -> int:
    if isinstance(value, str):
        return enum_value(enum, value)
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError(f"{value!r} is no number and no name of a {enum}")
    return value


def _truth(value: Any) -> bool:
    if value not in (True, False):  # 0 and 1 are equal to these
        raise ValueError(f"autocontinue is true or false, not {value!r}")
    return bool(value)


def _number(value: Any) -> float:
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{value!r} is no parameter: numbers, or null where nothing is given")
    return _as_float(value)


def _as_float(value: float) -> float:
    """A number as a float; one of Python's whole numbers that none can hold is infinite."""
    try:
        return float(value)
    except OverflowError:
        return math.inf


def items_of(items: Any) -> list[MissionItem]:
    """The items of a list of them, or of their JSON.

    Raises:
        ValueError: it is no such list; the text says which item is wrong.
    """
    if not isinstance(items, Sequence) or isinstance(items, str | bytes):
        raise ValueError(f"items must be a list, not {type(items).__name__}")
    if len(items) > MAX_ITEMS:
        raise ValueError(f"{len(items)} items are more than the {MAX_ITEMS} that MAVLink can count")
    read = []
    for number, item in enumerate(items):
        try:
            read.append(MissionItem.from_json(item))
        except ValueError as error:
            raise ValueError(f"item {number}: {error}") from error
    return read


def first_seq(kind: int, autopilot: int) -> int:
    """The number that a MAV_AUTOPILOT gives to the first item: ArduPilot's missions begin with home, as item 0."""
    return int(kind == KINDS["mission"] and autopilot_of(autopilot).home_is_an_item)
