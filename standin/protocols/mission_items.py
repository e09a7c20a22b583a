"""Items of missions, fences and rally points as messages: MISSION_ITEM_INT, and the old MISSION_ITEM."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite

from pymavlink.dialects.v20 import ardupilotmega as dialect

from standin.vehicle.location import ALT_MAX_M
from standin.vehicle.mission import COMMANDS, POSITION_COMMANDS, MissionFrame, MissionKind, StandinItem
from standin.wire.mavlink_codec import Message

Sender = tuple[int, int]
"""System and component."""
Form = Callable[[StandinItem, MissionKind, Sender, bool], Message]
LAT_MAX_E7, LON_MAX_E7 = 900_000_000, 1_800_000_000
NOWHERE_E7 = 2_000_000_000
"""What a place that is no number becomes: it is refused as one that is not on the earth."""


def item_from(message: Message, kind: MissionKind) -> StandinItem:
    """Return the item of a MISSION_ITEM_INT or a MISSION_ITEM."""
    head = (message.seq, message.frame, message.command)
    parameters = (message.param1, message.param2, message.param3, message.param4)
    x, y = message.x, message.y
    if message.get_type() == "MISSION_ITEM":
        scale = 1e7 if _has_place(message.command, kind) else 1.0
        x, y = _whole(x * scale), _whole(y * scale)
    return StandinItem(*head, *parameters, x, y, message.z, message.autocontinue)


def item_int_message(item: StandinItem, kind: MissionKind, to: Sender, current: bool) -> Message:
    """Return a MISSION_ITEM_INT."""
    place = (item.lat_e7, item.lon_e7, item.alt_m)
    return dialect.MAVLink_mission_item_int_message(*_head(item, to, current), *place, kind)


def item_message(item: StandinItem, kind: MissionKind, to: Sender, current: bool) -> Message:
    """Return a MISSION_ITEM: its places are good to a metre or so."""
    scale = 1e-7 if _has_place(item.command, kind) else 1.0
    place = (item.lat_e7 * scale, item.lon_e7 * scale, item.alt_m)
    return dialect.MAVLink_mission_item_message(*_head(item, to, current), *place, kind)


def _head(item: StandinItem, to: Sender, current: bool) -> tuple[float, ...]:
    parameters = (item.autocontinue, item.param1, item.param2, item.param3, item.param4)
    return (*to, item.seq, item.frame, item.command, int(current), *parameters)


def _has_place(command: int, kind: MissionKind) -> bool:
    return kind is not MissionKind.MISSION or command in POSITION_COMMANDS


def _whole(value: float) -> int:
    return round(value) if abs(value) < NOWHERE_E7 else NOWHERE_E7


def fault_of(item: StandinItem, kind: MissionKind) -> int:
    """Return why an item cannot be stored (MAV_MISSION_*), MAV_MISSION_ACCEPTED if it can."""
    if item.command not in COMMANDS[kind]:
        return int(dialect.MAV_MISSION_UNSUPPORTED)
    if _has_place(item.command, kind):
        if item.frame not in set(MissionFrame) - {MissionFrame.MISSION}:
            return int(dialect.MAV_MISSION_UNSUPPORTED_FRAME)
        if abs(item.lat_e7) > LAT_MAX_E7:
            return int(dialect.MAV_MISSION_INVALID_PARAM5_X)
        if abs(item.lon_e7) > LON_MAX_E7:
            return int(dialect.MAV_MISSION_INVALID_PARAM6_Y)
        if not abs(item.alt_m) <= ALT_MAX_M:
            return int(dialect.MAV_MISSION_INVALID_PARAM7)
    if not (isfinite(item.param1) and isfinite(item.param2)):
        return int(dialect.MAV_MISSION_INVALID)
    return int(dialect.MAV_MISSION_ACCEPTED)
