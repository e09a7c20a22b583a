"""The fields of every message, read from `msg/*.msg` (ROS 2 interface definitions, without arrays of fixed length)."""

from __future__ import annotations

import re
from functools import cache
from importlib import resources
from typing import Final, NamedTuple

from bridge.bus.messages import types

STANDARD: Final = {
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec\n",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/msg/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
}
"""Definitions of ROS 2 itself that ours use."""
PRIMITIVES: Final = {
    "bool": "?",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}
"""Format characters of `struct` by type; ``string`` is the one other type that is no message."""
STRING: Final = "string"
_LINE: Final = re.compile(r"(?P<type>[\w/]+)(?P<sequence>\[\])?\s+(?P<name>[a-z]\w*)")
_CONSTANT: Final = re.compile(r"\w+\s+[A-Z]\w*\s*=.*")


class MessageField(NamedTuple):
    """One field: ``type`` is a primitive, ``string`` or a message's name, such as ``std_msgs/msg/Header``."""

    name: str
    type: str
    is_sequence: bool


def definitions() -> dict[str, str]:
    """Text of every message definition by ROS 2 type name."""
    folder = resources.files("bridge.bus.messages") / "msg"
    ours = {
        f"{types.PACKAGE}/msg/{f.name[:-4]}": f.read_text()
        for f in folder.iterdir()
        if f.name.endswith(".msg")
    }
    return STANDARD | ours


@cache
def fields_of(name: str) -> tuple[MessageField, ...]:
    """The fields of the message type ``name`` in their order.

    Raises:
        KeyError: there is no such message.
        ValueError: its definition has a line that this reader does not know.
    """
    package, _, short = name.partition("/msg/")
    if package == types.PACKAGE:
        text = (resources.files("bridge.bus.messages") / "msg" / f"{short}.msg").read_text()
    else:
        text = STANDARD[name]
    lines = (line.split("#", 1)[0].strip() for line in text.splitlines())
    return tuple(_field(name, line) for line in lines if line and not _CONSTANT.fullmatch(line))


def _field(message: str, line: str) -> MessageField:
    match = _LINE.fullmatch(line)
    if match is None:
        raise ValueError(f"{message}: {line!r} is no field of a type that can be coded")
    kind = match["type"]
    if kind not in PRIMITIVES and kind != STRING:
        kind = kind.replace("/", "/msg/")
    return MessageField(match["name"], kind, match["sequence"] is not None)
