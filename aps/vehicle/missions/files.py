"""Files of missions: QGroundControl's .plan (JSON) and the waypoint files of MAVProxy and Mission Planner.

A .plan has mission, fence and rally points, a waypoint file a mission only. Home, which both have, is no item, but
their jumps (DO_JUMP) count it as 0: ``jumps_moved`` is for autopilots that do not. What an item does not give is null
in a .plan, and 0 in a waypoint file.
(https://docs.qgroundcontrol.com/master/en/qgc-dev-guide/file_formats/plan.html, https://mavlink.io/en/file_formats/)
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from aps.vehicle.missions.items import MissionItem
from aps.wire.dialect import enum_label, mavlink

Place = tuple[float, float, float]
WAYPOINT_HEADER: Final = "QGC WPL 110"
_COLUMNS: Final = 12
_RETURN_POINT: Final = int(mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT)
_VERTEX_IN: Final = int(mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION)
_VERTEX_OUT: Final = int(mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION)
_CIRCLE_IN: Final = int(mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION)
_CIRCLE_OUT: Final = int(mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION)
_RALLY: Final = int(mavlink.MAV_CMD_NAV_RALLY_POINT)
_ABOVE_HOME: Final = (
    int(mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT),
    int(mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT),
)
_JUMP: Final = int(mavlink.MAV_CMD_DO_JUMP)


@dataclass(frozen=True, slots=True)
class FlightPlan:
    """What one file can hold."""

    mission: list[MissionItem] = field(default_factory=list)
    fence: list[MissionItem] = field(default_factory=list)
    rally: list[MissionItem] = field(default_factory=list)
    home: Place | None = None
    """Where the plan was drawn around: latitude, longitude, degrees; height above mean sea level, m."""


def jumps_moved(mission: Sequence[MissionItem], by: int) -> list[MissionItem]:
    """The same items, each DO_JUMP leading to one that has a number higher ``by``."""
    return [item.jumping_to(item.params[0] + by) if item.command == _JUMP else item for item in mission]


def read_waypoints(text: str) -> FlightPlan:
    """The mission of a waypoint file.

    Raises:
        ValueError: it is none; the text says which line is wrong.
    """
    lines = text.replace("\ufeff", "").splitlines()
    if not lines or lines[0].split() != WAYPOINT_HEADER.split():
        raise ValueError(f"line 1: a waypoint file begins with {WAYPOINT_HEADER!r}")
    rows: list[MissionItem] = []
    for number, line in enumerate(lines[1:], 2):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            rows.append(_row(line.split(), len(rows)))
        except ValueError as error:
            raise ValueError(f"line {number}: {error}") from error
    if not rows:
        return FlightPlan()
    home: Any = _or_0(rows[0].params[4:])
    return FlightPlan(mission=rows[1:], home=home if any(home) else None)


def _row(words: list[str], seq: int) -> MissionItem:
    if len(words) != _COLUMNS:
        raise ValueError(f"{_COLUMNS} columns are expected, not {len(words)}")
    if int(words[0]) != seq:
        raise ValueError(f"item {words[0]} is where item {seq} should be")
    params = tuple(float(word) for word in words[4:11])
    return MissionItem(int(words[3]), params, int(words[2]), words[11] != "0")  # type: ignore[arg-type]


def _or_0(values: Sequence[float]) -> tuple[float, ...]:
    return tuple(0.0 if math.isnan(value) else value for value in values)


def write_waypoints(mission: Sequence[MissionItem], home: Place = (0.0, 0.0, 0.0)) -> str:
    """Text of a waypoint file, as MAVProxy, Mission Planner and QGroundControl read it."""
    first = MissionItem(int(mavlink.MAV_CMD_NAV_WAYPOINT), (0.0, 0.0, 0.0, 0.0, *home), frame=0)
    lines = [WAYPOINT_HEADER]
    for seq, item in enumerate([first, *mission]):
        numbers = "\t".join(f"{value:.8f}" for value in _or_0(item.params))
        lines.append(
            f"{seq}\t{int(seq == 0)}\t{item.frame}\t{item.command}\t{numbers}\t{int(item.autocontinue)}"
        )
    return "\n".join(lines) + "\n"


# QGroundControl's plans.


def read_plan(text: str) -> FlightPlan:
    """Mission, fence and rally points of a .plan file. Of surveys and the like: the items that they were made into.

    Raises:
        ValueError: it is none, or has something that is not known; the text says what.
    """
    try:
        plan = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"a plan is JSON: {error}") from error
    if not isinstance(plan, Mapping) or plan.get("fileType") != "Plan":
        raise ValueError('a plan has "fileType": "Plan"')
    mission = _mapping(plan, "mission")
    return FlightPlan(
        mission=_mission(_list(mission, "items")),
        fence=_fence(_mapping(plan, "geoFence")),
        rally=[_rally(place) for place in _list(_mapping(plan, "rallyPoints"), "points")],
        home=_home(mission.get("plannedHomePosition")),
    )


def _mapping(of: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = of.get(key, {})
    if not isinstance(value, Mapping):
        raise ValueError(f"{key!r} of a plan is an object, not {value!r:.40}")
    return value


def _list(of: Mapping[str, Any], key: str) -> list[Any]:
    value = of.get(key, [])
    if not isinstance(value, list):
        raise ValueError(f"{key!r} of a plan is a list, not {value!r:.40}")
    return value


def _numbers(values: Any, count: int, what: str) -> tuple[float, ...]:
    numeric = isinstance(values, list) and all(
        isinstance(value, int | float) and not isinstance(value, bool) for value in values
    )
    if not numeric or len(values) < count:
        raise ValueError(f"{what} has {count} numbers, unlike {values!r:.60}")
    try:
        found = tuple(float(value) for value in values[:count])
    except OverflowError as error:
        raise ValueError(f"{what}: {values!r:.60} is too large") from error
    if not all(map(math.isfinite, found)):
        raise ValueError(f"{what} has {count} numbers that are finite, unlike {values!r:.60}")
    return found


def _home(place: Any) -> Place | None:
    return None if place is None else _numbers(place, 3, "plannedHomePosition")  # type: ignore[return-value]


def _mission(listed: list[Any]) -> list[MissionItem]:
    """The items of a mission; its jumps, which name a ``doJumpId``, lead to numbers (home is 0)."""
    items: list[MissionItem] = []
    numbers: dict[Any, int] = {}
    for index, one in enumerate(listed):
        found = _items(one, f"item {index}")
        if one.get("type") != "ComplexItem":
            first = len(items) + 1
            jump_id = one.get("doJumpId", first)
            if isinstance(jump_id, bool) or not isinstance(jump_id, int):
                raise ValueError(f"item {index}: doJumpId is a whole number, not {jump_id!r:.40}")
            numbers.setdefault(jump_id, first)
        items += found
    return [_resolved(item, numbers) for item in items]


def _resolved(item: MissionItem, numbers: Mapping[Any, int]) -> MissionItem:
    if item.command != _JUMP:
        return item
    if item.params[0] not in numbers:
        raise ValueError(f"a DO_JUMP leads to doJumpId {item.params[0]:g}, and no item has that")
    return item.jumping_to(numbers[item.params[0]])


def _items(one: Any, where: str) -> list[MissionItem]:
    if not isinstance(one, Mapping):
        raise ValueError(f"{where} is an object, not {one!r:.40}")
    if one.get("type") == "ComplexItem":
        inner = _mapping(one, "TransectStyleComplexItem") or one
        if "Items" not in inner:
            raise ValueError(f"{where}: a {one.get('complexItemType', 'complex item')} without its items")
        parts = enumerate(_list(inner, "Items"))
        return [item for index, part in parts for item in _items(part, f"{where}.{index}")]
    plain = {"command", "params", "frame"}
    try:
        item = {key: one[key] for key in plain}
        return [MissionItem.from_json(item | {"autocontinue": one.get("autoContinue", True)})]
    except KeyError as error:
        raise ValueError(f"{where} has no {error}") from error
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error


def _fence(fence: Mapping[str, Any]) -> list[MissionItem]:
    items = []
    if fence.get("breachReturn") is not None:
        place = _numbers(fence["breachReturn"], 3, "breachReturn")
        items.append(MissionItem(_RETURN_POINT, (0.0, 0.0, 0.0, 0.0, *place)))  # type: ignore[arg-type]
    for polygon in _list(fence, "polygons"):
        path = _list(polygon, "path") if isinstance(polygon, Mapping) else []
        command = _VERTEX_IN if path and polygon.get("inclusion", True) else _VERTEX_OUT
        for vertex in path:
            place = (*_numbers(vertex, 2, "a vertex"), 0.0)
            items.append(MissionItem(command, (float(len(path)), 0.0, 0.0, 0.0, *place)))  # type: ignore[arg-type]
    for one in _list(fence, "circles"):
        circle = one.get("circle") if isinstance(one, Mapping) else None
        if not isinstance(circle, Mapping):
            raise ValueError(f"a circle of a fence has 'circle', unlike {one!r:.40}")
        place = (*_numbers(circle.get("center"), 2, "the centre of a circle"), 0.0)
        (radius_m,) = _numbers([circle.get("radius")], 1, "the radius of a circle")
        command = _CIRCLE_IN if one.get("inclusion", True) else _CIRCLE_OUT
        items.append(MissionItem(command, (radius_m, 0.0, 0.0, 0.0, *place)))  # type: ignore[arg-type]
    return items


def _rally(place: Any) -> MissionItem:
    return MissionItem(_RALLY, (0.0, 0.0, 0.0, 0.0, *_numbers(place, 3, "a rally point")))  # type: ignore[arg-type]


def write_plan(plan: FlightPlan, vehicle_type: int = 2, autopilot: int = 3) -> str:
    """Text of a .plan file, as QGroundControl reads it.

    Args:
        plan: what to write.
        vehicle_type: MAV_TYPE.
        autopilot: MAV_AUTOPILOT.

    Raises:
        ValueError: the fence or the rally points have an item that a plan cannot hold.
    """
    home = plan.home or next((item.params[4:] for item in plan.mission if item.is_placed), (0.0, 0.0, 0.0))
    content = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "mission": {
            "version": 2,
            "firmwareType": autopilot,
            "vehicleType": vehicle_type,
            "cruiseSpeed": 15,
            "hoverSpeed": 5,
            "globalPlanAltitudeMode": 1,
            "plannedHomePosition": list(_or_0(home)),
            "items": [_simple(item, number) for number, item in enumerate(plan.mission, 1)],
        },
        "geoFence": {"version": 2} | _fence_json(plan.fence),
        "rallyPoints": {
            "version": 2,
            "points": [_point(item) for item in plan.rally],
        },
    }
    return json.dumps(content, indent=4, allow_nan=False) + "\n"


def _point(item: MissionItem) -> tuple[float, ...]:
    if item.frame not in _ABOVE_HOME:
        frame = enum_label("MAV_FRAME", item.frame)
        raise ValueError(f"a plan has rally points above home, and one of {frame} is none")
    return _numbers(list(item.params[4:]), 3, "a rally point")


def _simple(item: MissionItem, number: int) -> dict[str, Any]:
    plain = item.to_json()
    return {
        "type": "SimpleItem",
        "autoContinue": plain["autocontinue"],
        "command": plain["command"],
        "doJumpId": number,
        "frame": plain["frame"],
        "params": plain["params"],
    }


def _fence_json(fence: Sequence[MissionItem]) -> dict[str, Any]:
    polygons: list[dict[str, Any]] = []
    circles: list[dict[str, Any]] = []
    content: dict[str, Any] = {"polygons": polygons, "circles": circles}
    left = 0
    for item in fence:
        if item.command == _RETURN_POINT:
            content["breachReturn"] = _numbers(list(item.params[4:]), 3, "the return point of a fence")
        elif item.command in (_VERTEX_IN, _VERTEX_OUT):
            if left == 0:
                left = int(item.params[0])
                inclusion = item.command == _VERTEX_IN
                polygons.append({"version": 1, "inclusion": inclusion, "path": []})
            polygons[-1]["path"].append(_numbers(list(item.params[4:6]), 2, "a vertex"))
            left = max(0, left - 1)
        elif item.command in (_CIRCLE_IN, _CIRCLE_OUT):
            centre = _numbers(list(item.params[4:6]), 2, "the centre of a circle")
            circle = {"center": centre, "radius": item.params[0]}
            circles.append({"version": 1, "inclusion": item.command == _CIRCLE_IN, "circle": circle})
        else:
            raise ValueError(f"command {item.command} is no part of a fence")
    return content
