"""Messages whose type only a run knows: what its agents log, and MAVLink by its fields. Their definitions, and CDR."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

from bridge.bus.messages import Header, encode
from bridge.bus.messages.codec import HEADER_BYTES
from bridge.bus.messages.sequences import aligned, of_numbers

TYPES: Final = {
    "number": "float64",
    "integer": "int64",
    "unsigned": "uint64",
    "bool": "bool",
    "text": "string",
    "vector": "float64[]",
    "text_or_none": "string[<=1]",
}
_EMPTY: Final = {"number": math.nan, "integer": 0, "unsigned": 0, "bool": False, "text": "", "vector": ()}
_AT_TIMES: Final = {"integer": "number", "bool": "number", "text": "text_or_none"}
_FORMATS: Final = {"number": "d", "integer": "q", "unsigned": "Q", "bool": "?"}
_WRITE_NUMBERS: Final = of_numbers("<", "d")[0]


class Field(NamedTuple):
    """One field: its key in the values, its name in the definition, and its kind."""

    key: str
    name: str
    kind: str


def kind_of(value: object) -> str:
    """The kind of a field that has this value."""
    if isinstance(value, bool):
        return "bool"
    if isinstance(value, str):
        return "text"
    if isinstance(value, int):
        return "integer"
    return "vector" if isinstance(value, Sequence) else "number"


class ValueType:
    """The type of messages with a header and fields of these kinds.

    Args:
        name: of the type, such as ``lostlink_logged/msg/Plan``.
        kinds: of the fields, by key.
    """

    def __init__(self, name: str, kinds: Mapping[str, str]) -> None:
        self.name = name
        taken: set[str] = {"header"}
        self.fields = tuple(Field(key, _unique(field_name(key), taken), kind) for key, kind in kinds.items())

    @property
    def definition(self) -> str:
        """As ROS 2 has it."""
        lines = [f"{TYPES[field.kind]} {field.name}\n" for field in self.fields]
        return "".join(["std_msgs/Header header\n", *lines])

    def encode(self, stamp_ns: int, frame_id: str, values: Mapping[str, Any]) -> bytes:
        """A message; what ``values`` lack, and what does not fit its kind, is empty: nan, 0, "", no items."""
        parts = [encode(Header.at(stamp_ns, frame_id))]
        position = len(parts[0]) - HEADER_BYTES
        for field in self.fields:
            parts.append(_piece(field.kind, values.get(field.key), position))
            position += len(parts[-1])
        return b"".join(parts)


def merged(one: str, other: str) -> str:
    """The kind of a field that has had values of both kinds."""
    if one == other:
        return one
    return "number" if {one, other} == {"number", "integer"} else "text"


def at_times(kind: str) -> str:
    """The kind of such a field that some messages lack: a number is nan there, and a list of one text empty."""
    return _AT_TIMES.get(kind, kind)


def _piece(kind: str, value: Any, position: int) -> bytes:
    if kind == "text_or_none":
        count = aligned("<", "I")[position & 7].pack(value is not None)
        return count if value is None else count + _piece("text", value, position + len(count))
    if value is None:
        value = _EMPTY[kind]
    if kind == "text":
        text = (value if isinstance(value, str) else str(value)).encode() + b"\0"
        return aligned("<", "I")[position & 7].pack(len(text)) + text
    if kind == "vector":
        return _WRITE_NUMBERS([float(each) for each in value], position)
    return aligned("<", _FORMATS[kind])[position & 7].pack(value)


def field_name(key: str) -> str:
    """A key as ROS 2 lets fields be called: small letters, digits and single underscores."""
    name = re.sub(r"_+", "_", re.sub(r"[^a-z0-9]", "_", key.lower())).strip("_")
    return name if name[:1].isalpha() else f"v_{name}".strip("_")


def type_name(text: str) -> str:
    """A text as ROS 2 lets types be called: ``error_m`` is ``ErrorM``."""
    name = "".join(part[:1].upper() + part[1:] for part in re.split(r"[^A-Za-z0-9]+", text))
    return name if name[:1].isalpha() else f"V{name}"


def _unique(name: str, taken: set[str]) -> str:
    found, number = name, 1
    while found in taken:
        number += 1
        found = f"{name}{number}"
    taken.add(found)
    return found


def unique_type(name: str, taken: set[str]) -> str:
    """``name``, with a number behind it if it is taken; then it is."""
    return _unique(name, taken)
