"""The mission protocol: upload, download, clear, set current. Without I/O; messages in, messages out.

As ArduPilot's, it asks for items with MISSION_REQUEST, and item 0 of a mission is home. Items come and go as
MISSION_ITEM_INT, and with old clients as MISSION_ITEM, of which one that says "fly there now" is a target for GUIDED.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as dialect

from standin.protocols.mission_items import (
    Form,
    Sender,
    fault_of,
    fence_fault,
    item_from,
    item_int_message,
    item_message,
)
from standin.protocols.targets import location_from
from standin.protocols.telemetry import TelemetryProtocol
from standin.vehicle.events import Severity
from standin.vehicle.mission import ITEMS_MAX, Command, MissionKind, StandinItem, home_item
from standin.vehicle.modes import Guided
from standin.vehicle.vehicle import StandinVehicle
from standin.wire.mavlink_codec import Message

UPLOAD_TIMEOUT_NS = 8_000_000_000
REQUEST_AGAIN_NS = 1_000_000_000
TARGET_NOW = 2
"""MISSION_ITEM.current of a target for GUIDED, as dronekit's ``simple_goto`` sends it."""


@dataclass(slots=True)
class _Upload:
    sender: Sender
    kind: MissionKind
    count: int
    heard_ns: int
    asked_ns: int
    items: list[StandinItem] = field(default_factory=list)


class MissionProtocol:
    """One vehicle's end of the protocol."""

    def __init__(
        self, vehicle: StandinVehicle, telemetry: TelemetryProtocol, send: Callable[[Message], None]
    ) -> None:
        self._vehicle = vehicle
        self._telemetry = telemetry
        self._mission = vehicle.mission
        self._send = send
        self._uploads: dict[MissionKind, _Upload] = {}
        self._others: dict[MissionKind, list[StandinItem]] = {MissionKind.FENCE: [], MissionKind.RALLY: []}

    @property
    def handlers(self) -> dict[str, Callable[[Message], None]]:
        """What to do with each message of the protocol."""
        return {
            "MISSION_COUNT": self._of_kind(self._begin_upload),
            "MISSION_ITEM_INT": self._of_kind(self._take_item),
            "MISSION_ITEM": self._of_kind(self._take_old_item),
            "MISSION_REQUEST_LIST": self._of_kind(self._send_count),
            "MISSION_REQUEST_INT": self._of_kind(self._send_item),
            "MISSION_REQUEST": self._of_kind(self._send_old_item),
            "MISSION_REQUEST_PARTIAL_LIST": self._refuse,
            "MISSION_WRITE_PARTIAL_LIST": self._refuse,
            "MISSION_CLEAR_ALL": self._of_kind(self._clear_all),
            "MISSION_SET_CURRENT": lambda message: self._set_current(message.seq),
        }

    def _of_kind(self, handler: Callable[[Message, MissionKind], None]) -> Callable[[Message], None]:
        """Refuse what is no mission, fence or list of rally points."""

        def handle(message: Message) -> None:
            if message.mission_type in tuple(MissionKind):
                handler(message, MissionKind(message.mission_type))
            else:
                self._refuse(message)

        return handle

    def _refuse(self, message: Message) -> None:
        self._acknowledge(_sender(message), dialect.MAV_MISSION_UNSUPPORTED, message.mission_type)

    def step(self) -> None:
        """Ask again for items that did not come; give uploads up that went silent."""
        now_ns = self._vehicle.sim_time_ns
        for upload in list(self._uploads.values()):
            if now_ns - upload.heard_ns > UPLOAD_TIMEOUT_NS:
                del self._uploads[upload.kind]
                self._acknowledge(upload.sender, dialect.MAV_MISSION_OPERATION_CANCELLED, upload.kind)
                self._vehicle.say(Severity.WARNING, f"{upload.kind.name.capitalize()} upload timeout")
            elif now_ns - upload.asked_ns > REQUEST_AGAIN_NS:
                self._ask(upload)

    # --- upload

    def _cancels(self, sender: Sender, kind: MissionKind) -> bool:
        """Give up the sender's own upload, if there is one; a list that another one uploads is denied."""
        upload = self._uploads.get(kind)
        if upload is not None and upload.sender != sender:
            self._acknowledge(sender, dialect.MAV_MISSION_DENIED, kind)
            return False
        self._uploads.pop(kind, None)
        return True

    def _begin_upload(self, message: Message, kind: MissionKind) -> None:
        sender, now_ns = _sender(message), self._vehicle.sim_time_ns
        if not self._cancels(sender, kind):
            return
        if message.count > ITEMS_MAX:
            self._acknowledge(sender, dialect.MAV_MISSION_NO_SPACE, kind)
            return
        upload = _Upload(sender, kind, message.count, now_ns, now_ns)
        if message.count == 0:
            self._finish_upload(upload)
        else:
            self._uploads[kind] = upload
            self._ask(upload)

    def _ask(self, upload: _Upload) -> None:
        upload.asked_ns = self._vehicle.sim_time_ns
        number = len(upload.items)
        self._send(dialect.MAVLink_mission_request_message(*upload.sender, number, upload.kind))

    def _take_item(self, message: Message, kind: MissionKind) -> None:
        sender, upload = _sender(message), self._uploads.get(kind)
        if upload is None:
            self._acknowledge(sender, dialect.MAV_MISSION_ERROR, kind)
            return
        if upload.sender != sender:
            self._acknowledge(sender, dialect.MAV_MISSION_DENIED, kind)
            return
        upload.heard_ns = self._vehicle.sim_time_ns
        item = item_from(message, kind)
        fault = fault_of(item, kind)
        if item.seq != len(upload.items):
            self._acknowledge(sender, dialect.MAV_MISSION_INVALID_SEQUENCE, kind)
        elif fault != dialect.MAV_MISSION_ACCEPTED:
            del self._uploads[kind]
            self._acknowledge(sender, fault, kind)
        else:
            upload.items.append(item)
            if len(upload.items) < upload.count:
                self._ask(upload)
            else:
                self._finish_upload(upload)

    def _take_old_item(self, message: Message, kind: MissionKind) -> None:
        if kind is MissionKind.MISSION and message.current == TARGET_NOW:
            self._fly_there(message)
        else:
            self._take_item(message, kind)

    def _fly_there(self, message: Message) -> None:
        """Take a target for GUIDED in the old form."""
        mode, place = self._vehicle.mode, (message.x, message.y, message.z)
        location = location_from(self._vehicle, *place, message.frame)
        result = dialect.MAV_MISSION_ERROR
        if message.command == Command.WAYPOINT and location is not None and isinstance(mode, Guided):
            mode.fly_to(self._vehicle.origin.ned_to(location))
            result = dialect.MAV_MISSION_ACCEPTED
        self._acknowledge(_sender(message), result, message.mission_type)

    def _finish_upload(self, upload: _Upload) -> None:
        self._uploads.pop(upload.kind, None)
        fault = fence_fault(upload.items) if upload.kind is MissionKind.FENCE else None
        if fault is not None:
            self._acknowledge(upload.sender, dialect.MAV_MISSION_ERROR, upload.kind)
            self._vehicle.say(*fault)
            self._vehicle.say(Severity.WARNING, "Fence validation failed")
            return
        self._store(upload.kind, upload.items)
        self._acknowledge(upload.sender, dialect.MAV_MISSION_ACCEPTED, upload.kind)
        if upload.kind is MissionKind.MISSION:
            self._vehicle.say(Severity.INFO, "Flight plan received")

    def _store(self, kind: MissionKind, items: list[StandinItem]) -> None:
        if kind is MissionKind.MISSION:
            self._mission.replace(items)
            self._mission.set_home(self._vehicle.home_or_origin)
        else:
            self._others[kind] = items

    # --- download and the rest

    def _send_count(self, message: Message, kind: MissionKind) -> None:
        sender = _sender(message)
        if kind in self._uploads:
            self._acknowledge(sender, dialect.MAV_MISSION_DENIED, kind)
            return
        count = len(self._mission if kind is MissionKind.MISSION else self._others[kind])
        self._send(dialect.MAVLink_mission_count_message(*sender, count, kind))

    def _send_item(self, message: Message, kind: MissionKind) -> None:
        self._send_as(item_int_message, message, kind)

    def _send_old_item(self, message: Message, kind: MissionKind) -> None:
        self._send_as(item_message, message, kind)

    def _send_as(self, form: Form, message: Message, kind: MissionKind) -> None:
        sender, item = _sender(message), self._item(kind, message.seq)
        if kind in self._uploads:
            self._acknowledge(sender, dialect.MAV_MISSION_DENIED, kind)
        elif item is None:
            self._acknowledge(sender, dialect.MAV_MISSION_INVALID_SEQUENCE, kind)
        else:
            current = kind is MissionKind.MISSION and item.seq == self._mission.current
            self._send(form(item, kind, sender, current))

    def _item(self, kind: MissionKind, seq: int) -> StandinItem | None:
        if kind is MissionKind.MISSION and seq == 0:  # home can be read without a mission, too
            return home_item(self._vehicle.home_or_origin)
        if kind is MissionKind.MISSION:
            return self._mission.item(seq)
        return self._others[kind][seq] if seq < len(self._others[kind]) else None

    def _set_current(self, seq: int) -> None:
        if self._mission.set_current(seq):
            self._send(self._telemetry.mission_current())

    def _clear_all(self, message: Message, kind: MissionKind) -> None:
        """Clear one kind, but no mission that is flown; ArduPilot knows no MAV_MISSION_TYPE_ALL."""
        sender = _sender(message)
        if not self._cancels(sender, kind):
            return
        result = dialect.MAV_MISSION_ACCEPTED
        if kind is not MissionKind.MISSION:
            self._store(kind, [])
        elif self._vehicle.armed and self._mission.running:
            result = dialect.MAV_MISSION_ERROR
        else:
            self._mission.clear()
        self._acknowledge(sender, result, kind)

    def _acknowledge(self, sender: Sender, result: int, mission_type: int) -> None:
        self._send(dialect.MAVLink_mission_ack_message(*sender, result, mission_type))


def _sender(message: Message) -> Sender:
    return message.get_srcSystem(), message.get_srcComponent()
