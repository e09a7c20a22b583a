"""MAVLink's events as text: EVENT carries a number and arguments, the autopilot's metadata what they mean. No I/O.

PX4 sends STATUSTEXT only on links where a ground station's heartbeat comes, events on all. Its metadata is a file of
the build, and of the autopilot itself. (https://mavlink.io/en/services/events.html, libevents' README)
"""

from __future__ import annotations

import json
import lzma
import re
import struct
from collections.abc import Mapping
from typing import Any, Final

from aps.vehicle.status_text import StatusText
from aps.wire.framer import Frame

__all__ = ["EVENT_ID", "METADATA_PATH", "EventTexts"]

EVENT_ID: Final = 410
METADATA_PATH: Final = "etc/extras/all_events.json.xz"
"""Where PX4 has its metadata, by MAVLink FTP."""
MAX_METADATA_BYTES: Final = 1 << 24
_LAYOUT: Final = struct.Struct("<IIHBBB40s")
"""id, event_time_boot_ms, sequence, destination component and system, log_levels, arguments: in wire order."""
_LEAST_LEVEL: Final = 7
"""External log levels up to debug are those of MAV_SEVERITY; beyond are protocol and disabled."""
_COMPONENT_SHIFT: Final = 24
_NUMBERS: Final = {
    "uint8_t": "B",
    "int8_t": "b",
    "uint16_t": "H",
    "int16_t": "h",
    "uint32_t": "I",
    "int32_t": "i",
    "uint64_t": "Q",
    "int64_t": "q",
    "float": "f",
}
_PLACEHOLDER: Final = re.compile(r"\\(.)|\{(\d+)(?::\.(\d+))?([^}]*)\}")
_UNIT: Final = {"m_v": " m", "m": " m", "m/s": " m/s"}
_SUMMARY: Final = "summary"
_CHECK_GROUPS: Final = frozenset({"arming_check", "health"})
_WARNING, _NOTICE = 4, 5
_MODE_BITS: Final = 32


class EventTexts:
    """Texts of one autopilot's events."""

    def __init__(self) -> None:
        self.known = False
        """Whether the metadata is there."""
        self._events: dict[int, Mapping[str, Any]] = {}
        self._enums: dict[str, Mapping[str, Any]] = {}
        self._checks: set[int] = set()
        """Events that say what is wrong, and in which modes that matters."""
        self._mode_bits: dict[int, int] = {}
        """``custom_mode`` -> its bit in a check's modes."""

    def learn(self, content: bytes) -> None:
        """Take the metadata, as JSON or xz of it.

        Raises:
            ValueError: it is none.
        """
        try:
            unpacker = lzma.LZMADecompressor()
            packed = content.startswith(b"\xfd7zXZ")
            plain = unpacker.decompress(content, MAX_METADATA_BYTES) if packed else content
            tree = json.loads(plain)
            for number, component in tree["components"].items():
                self._learn_component(int(number), component)
        except (lzma.LZMAError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise ValueError(f"no metadata of events: {error!r}") from error
        self.known = True

    def _learn_component(self, number: int, component: Mapping[str, Any]) -> None:
        space = component.get("namespace", "")
        for name, enum in component.get("enums", {}).items():
            self._enums[name] = self._enums[f"{space}::{name}"] = enum
        for name, group in component.get("event_groups", {}).items():
            events = {number << _COMPONENT_SHIFT | int(sub): event for sub, event in group["events"].items()}
            self._events |= events
            self._checks |= events.keys() if name in _CHECK_GROUPS else set()
        for bit, modes in component.get("navigation_mode_groups", {}).get("groups", {}).items():
            self._mode_bits |= dict.fromkeys(modes, 1 << min(int(bit), _MODE_BITS))

    def take(self, frame: Frame, custom_mode: int) -> StatusText | None:
        """The text of an EVENT; ``None`` for one that is not for people.

        A check that fails is a warning at least where it matters in the mode of now, a notice at most where not.
        """
        event_id, _, _, _, _, levels, raw = _LAYOUT.unpack(
            frame.payload[: _LAYOUT.size].ljust(_LAYOUT.size, b"\0")
        )
        level = levels & 0x0F
        if level > _LEAST_LEVEL:
            return None
        event = self._events.get(event_id)
        if event is None:
            return StatusText(level, f"event {event_id:#010x}, whose text is not known")
        if event.get("type") == _SUMMARY:
            return None
        if event_id in self._checks:
            matters = int.from_bytes(raw[:4], "little") & self._mode_bits.get(custom_mode, 0)
            level = min(level, _WARNING) if matters else max(level, _NOTICE)
        return StatusText(level, self._filled(str(event.get("message", event.get("name", ""))), event, raw))

    def _filled(self, text: str, event: Mapping[str, Any], raw: bytes) -> str:
        values = self._values(event.get("arguments", ()), raw)

        def fill(found: re.Match[str]) -> str:
            if found[1] is not None:
                return found[1]
            index = int(found[2]) - 1
            value = values[index] if 0 <= index < len(values) else "?"
            if found[3] is not None and isinstance(value, int | float):
                value = f"{value:.{int(found[3])}f}"
            return f"{value}{_UNIT.get(found[4], found[4])}"

        return _PLACEHOLDER.sub(fill, text)

    def _values(self, arguments: Any, raw: bytes) -> list[float | int | str]:
        """The arguments, one after the other without gaps; as far as their types are known."""
        values: list[float | int | str] = []
        at = 0
        for argument in arguments:
            enum = self._enums.get(argument.get("type", ""))
            code = _NUMBERS.get(argument.get("type", "") if enum is None else enum.get("type", ""))
            if code is None or at + struct.calcsize("<" + code) > len(raw):
                break
            (value,) = struct.unpack_from("<" + code, raw, at)
            at += struct.calcsize("<" + code)
            values.append(value if enum is None else _label(enum, value))
        return values


def _label(enum: Mapping[str, Any], value: int) -> str:
    entries: Mapping[str, Any] = enum.get("entries", {})
    entry = entries.get(str(value))
    if entry is not None:
        return str(entry.get("description") or entry.get("name"))
    if enum.get("is_bitfield"):
        names = [str(one.get("name")) for key, one in entries.items() if value & int(key)]
        return "|".join(names) or "none"
    return str(value)
