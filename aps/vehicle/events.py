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
from dataclasses import dataclass
from typing import Any, Final

from aps.vehicle.status_text import StatusText
from aps.wire.framer import Frame

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
_WHOLE: Final = _NUMBERS.keys() - {"float"}
"""What the numbers of an enum may be."""
_PLACEHOLDER: Final = re.compile(r"\\(.)|\{(\d+)(?::\.(\d+))?([^}]*)\}")
_UNIT: Final = {"m_v": " m", "m": " m", "m/s": " m/s"}
_SUMMARY: Final = "summary"
_CHECK_GROUPS: Final = frozenset({"arming_check", "health"})
_WARNING, _NOTICE = 4, 5
_MODE_BITS: Final = 32
_MAX_TEXT: Final = 1000
"""Characters of a message, of a label and of what comes of both: PX4's longest message has some 200."""
_MAX_DECIMALS: Final = 9
_MAX_ARGUMENTS: Final = 40
"""An event has so many bytes for them."""


@dataclass(frozen=True, slots=True)
class _Enum:
    """Names of numbers."""

    type: str
    is_bitfield: bool
    labels: Mapping[int, str]
    names: Mapping[int, str]

    def label(self, value: int) -> str:
        """What a number means."""
        found = self.labels.get(value)
        if found is None and self.is_bitfield:
            return "|".join(name for bit, name in self.names.items() if value & bit) or "none"
        return str(value) if found is None else found


@dataclass(frozen=True, slots=True)
class _Event:
    """What is said of one event."""

    message: str
    is_summary: bool
    argument_types: tuple[str, ...]


class _Metadata:
    """What a file of metadata says, as far as it is well-formed: a single event that is not is left out.

    Raises:
        ValueError, KeyError, TypeError, AttributeError, RecursionError: it is no metadata.
    """

    def __init__(self, plain: bytes) -> None:
        self.events: dict[int, _Event] = {}
        self.enums: dict[str, _Enum] = {}
        self.checks: set[int] = set()
        """Events that say what is wrong, and in which modes that matters."""
        self.mode_bits: dict[int, int] = {}
        """``custom_mode`` -> its bit in a check's modes."""
        for number, component in json.loads(plain)["components"].items():
            self._learn(int(number), component)

    def _learn(self, number: int, component: Mapping[str, Any]) -> None:
        space = component.get("namespace", "")
        for name, content in component.get("enums", {}).items():
            if (enum := _enum_of(content)) is not None:
                self.enums[name] = self.enums[f"{space}::{name}"] = enum
        for name, group in component.get("event_groups", {}).items():
            ids = {number << _COMPONENT_SHIFT | int(sub): event for sub, event in group["events"].items()}
            self.events |= {key: event for key, one in ids.items() if (event := _event_of(one)) is not None}
            self.checks |= ids.keys() if name in _CHECK_GROUPS else set()
        for bit, modes in component.get("navigation_mode_groups", {}).get("groups", {}).items():
            self.mode_bits |= dict.fromkeys(modes, 1 << min(int(bit), _MODE_BITS))


def _event_of(content: Any) -> _Event | None:
    """An event; ``None`` if it is said otherwise than its guide has it."""
    if not isinstance(content, dict):
        return None
    message, arguments = content.get("message", content.get("name", "")), content.get("arguments", [])
    if not isinstance(message, str) or not isinstance(arguments, list):
        return None
    if not all(isinstance(one, dict) and isinstance(one.get("type"), str) for one in arguments):
        return None
    types = tuple(one["type"] for one in arguments[:_MAX_ARGUMENTS])
    return _Event(_printable(message), content.get("type") == _SUMMARY, types)


def _enum_of(content: Any) -> _Enum | None:
    """An enum; ``None`` if it is said otherwise than its guide has it."""
    if not isinstance(content, dict) or content.get("type") not in _WHOLE:
        return None
    entries = content.get("entries", {})
    if not isinstance(entries, dict) or not all(isinstance(one, dict) for one in entries.values()):
        return None
    try:
        numbers = {int(key): one for key, one in entries.items()}
    except ValueError:
        return None
    names = {key: _printable(str(one.get("name"))) for key, one in numbers.items()}
    labels = {
        key: _printable(str(one["description"])) if one.get("description") else names[key]
        for key, one in numbers.items()
    }
    return _Enum(content["type"], bool(content.get("is_bitfield")), labels, names)


def _printable(text: str) -> str:
    """Short enough, and such that it can be encoded: JSON may have halves of characters."""
    return text[:_MAX_TEXT].encode("utf-8", "replace").decode()


class EventTexts:
    """Texts of one autopilot's events."""

    def __init__(self) -> None:
        self._metadata: _Metadata | None = None

    @property
    def known(self) -> bool:
        """Whether the metadata is there."""
        return self._metadata is not None

    def learn(self, content: bytes) -> None:
        """Take the metadata, as JSON or xz of it.

        Raises:
            ValueError: it is none.
        """
        try:
            if content.startswith(b"\xfd7zXZ"):
                content = lzma.LZMADecompressor().decompress(content, MAX_METADATA_BYTES)
            elif len(content) > MAX_METADATA_BYTES:
                raise ValueError(f"it has {len(content)} bytes")
            self._metadata = _Metadata(content)
        except (lzma.LZMAError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise ValueError(f"no metadata of events: {error!r}") from error

    def take(self, frame: Frame, custom_mode: int) -> StatusText | None:
        """The text of an EVENT, its number if there is no text; ``None`` for one that is not for people.

        A check that fails is a warning at least where it matters in the mode of now, a notice at most where not.
        """
        event_id, _, _, _, _, levels, raw = _LAYOUT.unpack(
            frame.payload[: _LAYOUT.size].ljust(_LAYOUT.size, b"\0")
        )
        level = levels & 0x0F
        if level > _LEAST_LEVEL:
            return None
        known = self._metadata
        event = None if known is None else known.events.get(event_id)
        if known is None or event is None:
            return StatusText(level, f"event {event_id:#010x}, whose text is not known")
        if event.is_summary:
            return None
        if event_id in known.checks:
            matters = int.from_bytes(raw[:4], "little") & known.mode_bits.get(custom_mode, 0)
            level = min(level, _WARNING) if matters else max(level, _NOTICE)
        return StatusText(level, _filled(event.message, _values(event, known.enums, raw)))


def _filled(message: str, values: list[float | int | str]) -> str:
    """The message with the values in the places that it has for them."""

    def fill(found: re.Match[str]) -> str:
        if found[1] is not None:
            return found[1]
        index = int(found[2][:_MAX_DECIMALS]) - 1
        value = values[index] if 0 <= index < len(values) else "?"
        if found[3] is not None and isinstance(value, int | float):
            value = f"{value:.{min(int(found[3][:_MAX_DECIMALS]), _MAX_DECIMALS)}f}"
        return f"{value}{_UNIT.get(found[4], found[4])}"

    return _PLACEHOLDER.sub(fill, message)[:_MAX_TEXT]


def _values(event: _Event, enums: Mapping[str, _Enum], raw: bytes) -> list[float | int | str]:
    """The arguments, one after the other without gaps; as far as their types are known."""
    values: list[float | int | str] = []
    at = 0
    for name in event.argument_types:
        enum = enums.get(name)
        code = _NUMBERS.get(name if enum is None else enum.type)
        if code is None or at + struct.calcsize("<" + code) > len(raw):
            break
        (value,) = struct.unpack_from("<" + code, raw, at)
        at += struct.calcsize("<" + code)
        values.append(value if enum is None else enum.label(value))
    return values
