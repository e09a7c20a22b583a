"""MAVLink message tables and encoding: the only module of ``aps`` that touches pymavlink.

The tables are read once, at import, from pymavlink's generated ``ardupilotmega`` dialect
(which includes ``common`` and ``minimal``).
"""

from __future__ import annotations

import struct
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

__all__ = [
    "ARDUPILOT",
    "AUTOPILOT_COMPID",
    "CRC_EXTRA",
    "ONBOARD_COMPUTER_COMPID",
    "PX4",
    "TARGET_OFFSETS",
    "Encoder",
    "enum_label",
    "enum_value",
    "has_location",
    "is_copter",
    "is_ground",
    "is_plane",
    "mavlink",
    "message_class",
    "message_fields",
    "message_name",
    "onboard_computer_heartbeat",
    "set_message_interval",
]

AUTOPILOT_COMPID: Final = int(mavlink.MAV_COMP_ID_AUTOPILOT1)
ARDUPILOT: Final = int(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
PX4: Final = int(mavlink.MAV_AUTOPILOT_PX4)
MAVLINK_VERSION: Final = 3
"""HEARTBEAT's field of that name."""
ONBOARD_COMPUTER_COMPID: Final = int(mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)


def _field_offset(message: Any, field: str) -> int:
    """Offset of a ``uint8_t`` field in the payload, in wire order; -1 if the message has none."""
    names: list[str] = message.ordered_fieldnames
    if field not in names:
        return -1
    sizes = {"b": 1, "B": 1, "c": 1, "h": 2, "H": 2, "i": 4, "I": 4, "f": 4, "q": 8, "Q": 8, "d": 8}
    formats = bytes(message.native_format).decode()[1:]
    offset = 0
    for name, kind, count in zip(names, formats, message.array_lengths, strict=True):
        if name == field:
            return offset
        offset += sizes[kind] * (count or 1)
    raise LookupError(f"{message.msgname}.{field} is not in its own layout")


def _target_field(message: Any) -> str:
    """Name of the target system's field: the definitions have one that is called otherwise."""
    return "target" if message.msgname == "MANUAL_CONTROL" else "target_system"


CRC_EXTRA: Final[dict[int, bytes]] = {
    msg_id: bytes([message.crc_extra]) for msg_id, message in mavlink.mavlink_map.items()
}
"""Message id -> the byte that its definition adds to the checksum."""

TARGET_OFFSETS: Final[dict[int, tuple[int, int]]] = {
    msg_id: offsets
    for msg_id, message in mavlink.mavlink_map.items()
    if (
        offsets := (
            _field_offset(message, _target_field(message)),
            _field_offset(message, "target_component"),
        )
    )[0]
    >= 0
}
"""Message id -> payload offsets of (target_system, target_component); -1 where there is no component."""


def message_name(msg_id: int) -> str:
    """Name of a message, or ``UNKNOWN_<id>``."""
    message = mavlink.mavlink_map.get(msg_id)
    return str(message.msgname) if message is not None else f"UNKNOWN_{msg_id}"


def message_fields(frame: bytes) -> dict[str, Any]:
    """The fields of a whole frame with a good checksum, by name; empty if its content cannot be decoded."""
    try:
        message = mavlink.MAVLink(None).decode(bytearray(frame))
    except (mavlink.MAVError, struct.error, ValueError, TypeError, IndexError):
        return {}
    return {name: getattr(message, name) for name in message.fieldnames}


def unsigned_64_bit_fields(msg_id: int) -> frozenset[str]:
    """Names of a known message's fields that are unsigned numbers of 64 bits, or arrays of them."""
    message = mavlink.mavlink_map[msg_id]
    types = zip(message.fieldnames, message.fieldtypes, strict=True)
    return frozenset(name for name, kind in types if kind == "uint64_t")


def enum_label(enum: str, value: int) -> str:
    """Label of an enum's value without the enum's name in front, e.g. ``DENIED`` for MAV_RESULT 2."""
    entry = mavlink.enums[enum].get(value)
    return str(entry.name).removeprefix(enum + "_") if entry is not None else str(value)


def enum_value(enum: str, label: str) -> int:
    """Value of an enum's label, with or without the enum's name in front.

    Raises:
        ValueError: it has no such label.
    """
    whole = label if label.startswith(enum + "_") else f"{enum}_{label}"
    for value, entry in mavlink.enums[enum].items():
        if entry.name == whole:
            return int(value)
    raise ValueError(f"{label!r} is no {enum}")


def has_location(command: int) -> bool:
    """Whether x and y of a MAV_CMD are a position."""
    entry = mavlink.enums["MAV_CMD"].get(command)
    return entry is not None and bool(entry.has_location)


def message_class(name: str) -> Any:
    """The class in pymavlink of a message.

    Raises:
        ValueError: there is no message of this name.
    """
    known = isinstance(name, str) and name.isidentifier()
    found = getattr(mavlink, f"MAVLink_{name.lower()}_message", None) if known else None
    if found is None:
        raise ValueError(f"there is no MAVLink message {name!r}")
    return found


_COPTER_TYPES: Final = frozenset(
    {
        mavlink.MAV_TYPE_QUADROTOR,
        mavlink.MAV_TYPE_COAXIAL,
        mavlink.MAV_TYPE_HELICOPTER,
        mavlink.MAV_TYPE_HEXAROTOR,
        mavlink.MAV_TYPE_OCTOROTOR,
        mavlink.MAV_TYPE_TRICOPTER,
        mavlink.MAV_TYPE_DECAROTOR,
        mavlink.MAV_TYPE_DODECAROTOR,
    }
)
# 19..25 are the VTOL types; pymavlink's releases name 22..25 differently.
_PLANE_TYPES: Final = frozenset({mavlink.MAV_TYPE_FIXED_WING, *range(mavlink.MAV_TYPE_VTOL_DUOROTOR, 26)})
_GROUND_TYPES: Final = frozenset({mavlink.MAV_TYPE_GROUND_ROVER, mavlink.MAV_TYPE_SURFACE_BOAT})


def is_ground(vehicle_type: int) -> bool:
    """Whether a MAV_TYPE drives or swims on the surface."""
    return vehicle_type in _GROUND_TYPES


def is_copter(vehicle_type: int) -> bool:
    """Whether a MAV_TYPE flies ArduCopter's modes."""
    return vehicle_type in _COPTER_TYPES


def is_plane(vehicle_type: int) -> bool:
    """Whether a MAV_TYPE flies ArduPlane's modes (fixed wing and VTOL)."""
    return vehicle_type in _PLANE_TYPES


def onboard_computer_heartbeat() -> Any:
    """HEARTBEAT of a computer on board of the UA."""
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
        mavlink.MAV_AUTOPILOT_INVALID,
        0,
        0,
        mavlink.MAV_STATE_ACTIVE,
        MAVLINK_VERSION,
    )


def set_message_interval(sysid: int, msg_id: int, interval_us: int) -> Any:
    """COMMAND_LONG that asks the autopilot of a system for a message every ``interval_us``."""
    command = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
    params = (float(msg_id), float(interval_us), 0.0, 0.0, 0.0, 0.0, 0.0)
    return mavlink.MAVLink_command_long_message(sysid, AUTOPILOT_COMPID, command, 0, *params)


class Encoder:
    """Encodes messages as MAVLink 2 from one system and component, counting its own sequence."""

    def __init__(self, sysid: int, compid: int) -> None:
        if not 1 <= sysid <= 255 or not 1 <= compid <= 255:
            raise ValueError(f"sysid {sysid} and compid {compid} must be in 1..255")
        self.sysid = sysid
        self.compid = compid
        self._mav: Any = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid)

    def encode(self, message: Any) -> bytes:
        """Bytes of a pymavlink message under the next sequence number."""
        packed = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        return packed
