"""Messages of ArduPilot's data flash logs (.bin), without I/O.

A log is a row of messages: A3 95, a type, and fields whose layout a FMT message (type 128) said before. What is damaged
is skipped up to the next message that is whole; nothing raises but a log without any message.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Final, NamedTuple

HEAD: Final = b"\xa3\x95"
FMT_TYPE: Final = 128
FMT: Final = struct.Struct("<BB4s16s64s")
HEAD_BYTES: Final = 3
FIELDS: Final[dict[str, tuple[str, float]]] = {
    "a": ("64s", 1), "b": ("b", 1), "B": ("B", 1), "h": ("h", 1), "H": ("H", 1), "i": ("i", 1), "I": ("I", 1),
    "q": ("q", 1), "Q": ("Q", 1), "g": ("e", 1), "f": ("f", 1), "d": ("d", 1), "n": ("4s", 1), "N": ("16s", 1),
    "Z": ("64s", 1), "c": ("h", 0.01), "C": ("H", 0.01), "e": ("i", 0.01), "E": ("I", 0.01), "L": ("i", 1e-7),
    "M": ("B", 1),
}  # fmt: skip
"""Format letter of ArduPilot -> struct's, and what the number is multiplied by."""

Value = float | bytes


class DataflashError(ValueError):
    """Bytes that are no data flash log."""


class _Layout(NamedTuple):
    name: str
    struct: struct.Struct
    columns: tuple[str, ...]
    factors: tuple[float, ...]


def read_messages(data: bytes, name: str) -> list[dict[str, Value]]:
    """Return all messages of a name, as column -> value.

    Raises:
        DataflashError: not a data flash log.
    """
    layouts: dict[int, _Layout] = {}
    out: list[dict[str, Value]] = []
    for kind, body in _whole_messages(data, layouts):
        layout = layouts.get(kind)
        if layout is not None and layout.name == name:
            values = layout.struct.unpack(body)
            out.append({
                column: value if isinstance(value, bytes) else value * factor
                for column, value, factor in zip(layout.columns, values, layout.factors, strict=True)
            })  # fmt: skip
    if not layouts:
        raise DataflashError("no format messages: not a data flash log")
    return out


def _whole_messages(data: bytes, layouts: dict[int, _Layout]) -> Iterator[tuple[int, bytes]]:
    """Yield type and fields of each message; formats go into `layouts`."""
    position = data.find(HEAD)
    while 0 <= position <= len(data) - HEAD_BYTES:
        kind = data[position + 2]
        layout = layouts.get(kind)
        start = position + HEAD_BYTES
        size = FMT.size if kind == FMT_TYPE else layout.struct.size if layout is not None else None
        if size is None or start + size > len(data) or not _next_is_a_message(data, start + size):
            position = data.find(HEAD, position + 1)
            continue
        body = data[start : start + size]
        if kind == FMT_TYPE:
            described = _layout(body)
            if described is not None:
                layouts[described[0]] = described[1]
        else:
            yield kind, body
        position = start + size


def _next_is_a_message(data: bytes, position: int) -> bool:
    return position == len(data) or data.startswith(HEAD, position) or len(data) - position < len(HEAD)


def _layout(body: bytes) -> tuple[int, _Layout] | None:
    kind, length, name, letters, columns = FMT.unpack(body)
    try:
        fields = [FIELDS[letter] for letter in letters.rstrip(b"\0").decode("ascii")]
        names = tuple(columns.rstrip(b"\0").decode("ascii").split(","))
        layout = struct.Struct("<" + "".join(letter for letter, _ in fields))
        text = name.rstrip(b"\0").decode("ascii")
    except (KeyError, UnicodeDecodeError):
        return None
    if kind == FMT_TYPE or layout.size + HEAD_BYTES != length or len(names) != len(fields):
        return None
    return kind, _Layout(text, layout, names, tuple(factor for _, factor in fields))
