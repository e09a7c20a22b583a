"""Items of missions, fences and rally points as messages: MISSION_ITEM_INT, and the old MISSION_ITEM."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf, isfinite, isnan

from pymavlink.dialects.v20 import ardupilotmega as dialect

from standin.vehicle.events import Severity
from standin.vehicle.location import ALT_MAX_M
from standin.vehicle.mission import (
    COMMANDS,
    POSITION_COMMANDS,
    Command,
    MissionFrame,
    MissionKind,
    StandinItem,
)
from standin.wire.mavlink_codec import Message

Sender = tuple[int, int]
"""System and component."""
Form = Callable[[StandinItem, MissionKind, Sender, bool], Message]
LAT_MAX_E7, LON_MAX_E7 = 900_000_000, 1_800_000_000
HEIGHT_END_M = {MissionKind.MISSION: ALT_MAX_M, MissionKind.FENCE: inf, MissionKind.RALLY: 32_768.0}
"""No height of an item is so far from zero: a fence keeps none, a rally point whole metres in 16 bits."""
VERTICES_MIN, VERTICES_MAX = 3, 255
POLYGONS = (
    dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
)
"""Commands of a fence whose first parameter is the number of its vertices."""
YAW = 4
WITH_YAW = frozenset({Command.WAYPOINT, Command.LAND, Command.TAKEOFF})
"""Commands whose parameter ``YAW`` may be NaN."""
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
    if kind is MissionKind.MISSION and (number := _wrong_parameter(item)):
        return int(dialect.MAV_MISSION_INVALID_PARAM1) + number - 1
    if item.command not in COMMANDS[kind]:
        return int(dialect.MAV_MISSION_UNSUPPORTED)
    if kind is MissionKind.FENCE and not item.param1 <= _param1_max(item.command):
        return int(dialect.MAV_MISSION_INVALID_PARAM1)
    if _has_place(item.command, kind):
        if item.frame not in set(MissionFrame) - {MissionFrame.MISSION}:
            return int(dialect.MAV_MISSION_UNSUPPORTED_FRAME)
        if abs(item.lat_e7) > LAT_MAX_E7:
            return int(dialect.MAV_MISSION_INVALID_PARAM5_X)
        if abs(item.lon_e7) > LON_MAX_E7:
            return int(dialect.MAV_MISSION_INVALID_PARAM6_Y)
        if not abs(item.alt_m) < HEIGHT_END_M[kind]:
            return int(dialect.MAV_MISSION_INVALID_PARAM7)
    return int(dialect.MAV_MISSION_ACCEPTED)


def _param1_max(command: int) -> float:
    return VERTICES_MAX if command in POLYGONS else inf


def _wrong_parameter(item: StandinItem) -> int:
    """Return the number of the first parameter that is not finite and has to be, 0 if there is none.

    A yaw may be left open where ArduPilot has none of its own (``AP_Mission::sanity_check_params``).
    """
    for number, value in enumerate((item.param1, item.param2, item.param3, item.param4), 1):
        is_open = isnan(value) and number == YAW and item.command in WITH_YAW
        if not isfinite(value) and not is_open:
            return number
    return 0


def fence_fault(items: Sequence[StandinItem]) -> tuple[Severity, str] | None:
    """Return what ArduPilot says against a fence, if anything (``AC_PolyFence_loader::validate_fence``)."""
    first, left, returns = None, 0, 0
    for item in items:
        if item.command in POLYGONS:
            vertices = int(item.param1)
            if vertices < VERTICES_MIN:
                return Severity.WARNING, f"Invalid vertex count ({vertices})"
            if first is None or not left:
                first, left = item, vertices
            elif item.command != first.command:
                return Severity.WARNING, "Received incorrect vertex type"
            elif item.param1 != first.param1:
                return Severity.WARNING, f"Unexpected vertex count want={first.param1:.0f} got={vertices}"
            left -= 1
        elif left:
            return Severity.WARNING, "Received incorrect type"
        elif item.command == dialect.MAV_CMD_NAV_FENCE_RETURN_POINT:
            returns += 1
            if returns > 1:
                return Severity.WARNING, "Multiple return points"
        elif not item.param1 > 0.0:
            return Severity.WARNING, "Non-positive circle radius"
    return (Severity.INFO, "Incorrect item count") if left else None
