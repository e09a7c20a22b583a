"""The mission protocol: upload, download, clear, set current. Without I/O; messages in, messages out.

As ArduPilot's, it asks for items with MISSION_REQUEST and takes MISSION_ITEM_INT or MISSION_ITEM; item 0 is
home.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import isfinite

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridge.standin.protocols.telemetry import Telemetry
from bridge.standin.vehicle.events import Severity
from bridge.standin.vehicle.location import ALT_MAX_M
from bridge.standin.vehicle.mission import ITEMS_MAX, Command, Frame, MissionItem
from bridge.standin.vehicle.vehicle import Vehicle
from bridge.standin.wire.mavlink_codec import Message

UPLOAD_TIMEOUT_NS = 8_000_000_000
REQUEST_AGAIN_NS = 1_000_000_000
POSITION_COMMANDS = frozenset(
    {Command.WAYPOINT, Command.LOITER_UNLIMITED, Command.LOITER_TIME, Command.LAND, Command.TAKEOFF}
)


@dataclass(slots=True)
class _Upload:
    system: int
    component: int
    count: int
    heard_ns: int
    asked_ns: int
    items: list[MissionItem] = field(default_factory=list)


class MissionProtocol:
    """One vehicle's end of the protocol."""

    def __init__(self, vehicle: Vehicle, telemetry: Telemetry, send: Callable[[Message], None]) -> None:
        self._vehicle = vehicle
        self._telemetry = telemetry
        self._mission = vehicle.mission
        self._send = send
        self._upload: _Upload | None = None

    def handle(self, message: Message, now_ns: int) -> bool:
        """Take a message of the protocol; return False if it is none."""
        kind = message.get_type()
        if kind not in _KINDS:
            return False
        if getattr(message, "mission_type", 0) != dialect.MAV_MISSION_TYPE_MISSION:
            self._other_type(message, kind)
        elif kind == "MISSION_COUNT":
            self._begin_upload(message, now_ns)
        elif kind in ("MISSION_ITEM_INT", "MISSION_ITEM"):
            self._take_item(message, now_ns)
        elif kind == "MISSION_REQUEST_LIST":
            self._send_count(message)
        elif kind in ("MISSION_REQUEST_INT", "MISSION_REQUEST"):
            self._send_item(message, kind)
        elif kind == "MISSION_CLEAR_ALL":
            self._clear(message)
        elif kind == "MISSION_SET_CURRENT":
            self._set_current(message.seq)
        return True

    def step(self, now_ns: int) -> None:
        """Ask again for an item that did not come; give an upload up that went silent."""
        upload = self._upload
        if upload is None:
            return
        if now_ns - upload.heard_ns > UPLOAD_TIMEOUT_NS:
            self._upload = None
            self._acknowledge(upload.system, upload.component, dialect.MAV_MISSION_OPERATION_CANCELLED)
        elif now_ns - upload.asked_ns > REQUEST_AGAIN_NS:
            self._ask(upload, now_ns)

    # --- upload

    def _begin_upload(self, message: Message, now_ns: int) -> None:
        system, component = message.get_srcSystem(), message.get_srcComponent()
        running = self._upload
        if running is not None and (running.system, running.component) != (system, component):
            self._acknowledge(system, component, dialect.MAV_MISSION_DENIED)
            return
        self._upload = None
        if message.count > ITEMS_MAX:
            self._acknowledge(system, component, dialect.MAV_MISSION_NO_SPACE)
        elif message.count == 0:
            self._mission.replace([])
            self._acknowledge(system, component, dialect.MAV_MISSION_ACCEPTED)
        else:
            self._upload = _Upload(system, component, message.count, now_ns, now_ns)
            self._ask(self._upload, now_ns)

    def _ask(self, upload: _Upload, now_ns: int) -> None:
        upload.asked_ns = now_ns
        self._send(
            dialect.MAVLink_mission_request_message(upload.system, upload.component, len(upload.items), 0)
        )

    def _take_item(self, message: Message, now_ns: int) -> None:
        system, component = message.get_srcSystem(), message.get_srcComponent()
        upload = self._upload
        if upload is None:
            if message.current == 2:  # the old way to send a GUIDED target
                self._acknowledge(system, component, dialect.MAV_MISSION_UNSUPPORTED)
            else:
                self._acknowledge(system, component, dialect.MAV_MISSION_ERROR)
            return
        if (upload.system, upload.component) != (system, component):
            self._acknowledge(system, component, dialect.MAV_MISSION_DENIED)
            return
        upload.heard_ns = now_ns
        if message.seq != len(upload.items):
            self._acknowledge(system, component, dialect.MAV_MISSION_INVALID_SEQUENCE)
            return
        item = item_from(message)
        fault = fault_of(item)
        if fault != dialect.MAV_MISSION_ACCEPTED:
            self._upload = None
            self._acknowledge(system, component, fault)
            return
        upload.items.append(item)
        if len(upload.items) < upload.count:
            self._ask(upload, now_ns)
        else:
            self._upload = None
            self._mission.replace(upload.items)
            self._mission.set_home(self._vehicle.home_or_origin)
            self._acknowledge(system, component, dialect.MAV_MISSION_ACCEPTED)
            self._vehicle.say(Severity.INFO, "Flight plan received")

    # --- download and the rest

    def _send_count(self, message: Message) -> None:
        system, component = message.get_srcSystem(), message.get_srcComponent()
        if self._upload is not None:
            self._acknowledge(system, component, dialect.MAV_MISSION_DENIED)
            return
        self._send(dialect.MAVLink_mission_count_message(system, component, len(self._mission), 0))

    def _send_item(self, message: Message, kind: str) -> None:
        system, component = message.get_srcSystem(), message.get_srcComponent()
        item = self._mission.item(message.seq)
        if self._upload is not None:
            self._acknowledge(system, component, dialect.MAV_MISSION_DENIED)
        elif item is None:
            if kind == "MISSION_REQUEST_INT":
                self._send(dialect.MAVLink_mission_count_message(system, component, len(self._mission), 0))
            self._acknowledge(system, component, dialect.MAV_MISSION_INVALID_SEQUENCE)
        else:
            current = int(item.seq == self._mission.current)
            self._send(_message_from(item, system, component, current, whole=kind == "MISSION_REQUEST_INT"))

    def _set_current(self, seq: int) -> None:
        if self._mission.set_current(seq):
            self._send(self._telemetry.mission_current())

    def _clear(self, message: Message) -> None:
        self._upload = None
        self._mission.replace([])
        self._acknowledge(message.get_srcSystem(), message.get_srcComponent(), dialect.MAV_MISSION_ACCEPTED)

    def _other_type(self, message: Message, kind: str) -> None:
        """Fences and rally points: there are none, and none can be stored."""
        system, component = message.get_srcSystem(), message.get_srcComponent()
        if kind == "MISSION_REQUEST_LIST":
            self._send(dialect.MAVLink_mission_count_message(system, component, 0, message.mission_type))
        else:
            self._acknowledge(system, component, dialect.MAV_MISSION_UNSUPPORTED, message.mission_type)

    def _acknowledge(self, system: int, component: int, result: int, mission_type: int = 0) -> None:
        self._send(dialect.MAVLink_mission_ack_message(system, component, result, mission_type))


_KINDS = frozenset(
    {
        "MISSION_COUNT",
        "MISSION_ITEM_INT",
        "MISSION_ITEM",
        "MISSION_REQUEST_LIST",
        "MISSION_REQUEST_INT",
        "MISSION_REQUEST",
        "MISSION_CLEAR_ALL",
        "MISSION_SET_CURRENT",
    }
)


def item_from(message: Message) -> MissionItem:
    """Return the item of a MISSION_ITEM_INT or MISSION_ITEM."""
    whole = message.get_type() == "MISSION_ITEM_INT"
    lat_e7, lon_e7 = (message.x, message.y) if whole else (_degrees_e7(message.x), _degrees_e7(message.y))
    return MissionItem(
        message.seq,
        message.frame,
        message.command,
        message.param1,
        message.param2,
        message.param3,
        message.param4,
        lat_e7,
        lon_e7,
        message.z,
        message.autocontinue,
    )


def fault_of(item: MissionItem) -> int:
    """Return why an item cannot be stored (MAV_MISSION_*), MAV_MISSION_ACCEPTED if it can."""
    if item.command not in set(Command):
        return int(dialect.MAV_MISSION_UNSUPPORTED)
    if item.command in POSITION_COMMANDS:
        if item.frame not in set(Frame) - {Frame.MISSION}:
            return int(dialect.MAV_MISSION_UNSUPPORTED_FRAME)
        if abs(item.lat_e7) > 900_000_000:
            return int(dialect.MAV_MISSION_INVALID_PARAM5_X)
        if abs(item.lon_e7) > 1_800_000_000:
            return int(dialect.MAV_MISSION_INVALID_PARAM6_Y)
        if not abs(item.alt_m) <= ALT_MAX_M:
            return int(dialect.MAV_MISSION_INVALID_PARAM7)
    if not (isfinite(item.param1) and isfinite(item.param2)):
        return int(dialect.MAV_MISSION_INVALID)
    return int(dialect.MAV_MISSION_ACCEPTED)


def _message_from(item: MissionItem, system: int, component: int, current: int, *, whole: bool) -> Message:
    head = (system, component, item.seq, item.frame, item.command, current, item.autocontinue)
    parameters = (item.param1, item.param2, item.param3, item.param4)
    if whole:
        return dialect.MAVLink_mission_item_int_message(
            *head, *parameters, item.lat_e7, item.lon_e7, item.alt_m, 0
        )
    return dialect.MAVLink_mission_item_message(
        *head, *parameters, item.lat_e7 * 1e-7, item.lon_e7 * 1e-7, item.alt_m, 0
    )


def _degrees_e7(value: float) -> int:
    return round(value * 1e7) if isfinite(value) and abs(value) <= 200.0 else 2_000_000_000
