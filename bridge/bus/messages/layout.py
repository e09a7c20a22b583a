"""A message's layout in CDR, compiled once from its definition to two Python functions, as `dataclasses` does it.

Numbers that follow each other without a string or a sequence between them, also through nested messages, are coded in
one `struct` call. What is compiled for Header:

    def write(m, p):
        m0 = m.stamp
        t0 = m.frame_id.encode() + b"\\0"
        x0 = s0[p & 7].pack(m0.sec, m0.nanosec, len(t0))
        p += len(x0) + len(t0)
        return b"".join((x0, t0,))

    def read(d, p):
        s = s0[p & 7]
        v0, v1, n = s.unpack_from(d, p)
        p += s.size
        v2 = text_at(d, p, n)
        p += n
        return Header(Time(v0, v1), v2), p
"""

from __future__ import annotations

from functools import cache
from typing import Any, Final, NamedTuple

from bridge.bus.messages import types
from bridge.bus.messages.definitions import PRIMITIVES, STRING, MessageField, fields_of
from bridge.bus.messages.records import maker_of
from bridge.bus.messages.sequences import (
    Reader,
    Writer,
    aligned,
    of_bytes,
    of_items,
    of_numbers,
    of_texts,
    text_at,
)
from bridge.bus.messages.types import Message

CLASSES: Final[dict[str, type[Message]]] = {c.TYPE: c for c in vars(types).values() if hasattr(c, "TYPE")}
"""Every record of `types` by its ROS 2 type name."""


class Layout(NamedTuple):
    """How a message type is written and read."""

    write: Writer
    read: Reader


@cache
def layout_of(name: str, order: str) -> Layout:
    """The layout of the message type ``name``.

    Args:
        name: such as ``std_msgs/msg/Header``.
        order: of bytes: ``<`` or ``>``, as in `struct`.
    """
    compiler = _Compiler(order)
    record = compiler.message(name, "m")
    compiler.end_of_numbers()
    source = "\n    ".join(
        ["def write(m, p):", *compiler.writes, f'return b"".join(({"".join(compiler.pieces)}))']
    )
    source += "\n" + "\n    ".join(["def read(d, p):", *compiler.reads, f"return {record}, p"])
    exec(compile(source, f"<layout of {name}>", "exec"), compiler.scope)  # from definitions of our own
    return Layout(compiler.scope["write"], compiler.scope["read"])


class _Compiler:
    """Collects the lines of both functions, and the names that they use."""

    def __init__(self, order: str) -> None:
        self.scope: dict[str, Any] = {"text_at": text_at}
        self.writes: list[str] = []
        self.reads: list[str] = []
        self.pieces: list[str] = []
        self._order = order
        self._numbers: list[tuple[str, str, str]] = []
        self._names = 0

    def message(self, name: str, owner: str) -> str:
        """Take a message apart, which ``owner`` is in `write`; returns the expression that `read` makes of it."""
        record = CLASSES[name]
        self.scope[record.__name__] = maker_of(record)
        return f"{record.__name__}({', '.join(self._field(field, owner) for field in fields_of(name))})"

    def _field(self, field: MessageField, owner: str) -> str:
        place, value = f"{owner}.{field.name}", self._name("v")
        if field.is_sequence:
            self._sequence(field, place, value)
        elif field.type in PRIMITIVES:
            self._numbers.append((place, PRIMITIVES[field.type], value))
        elif field.type == STRING:
            self._text(place, value)
        else:
            nested = self._name("m")
            self.writes.append(f"{nested} = {place}")
            return self.message(field.type, nested)
        return value

    def end_of_numbers(self) -> None:
        """Code the numbers so far in one call."""
        if self._numbers:
            piece = self._pack([])
            self.writes.append(f"p += len({piece})")

    def _text(self, place: str, value: str) -> None:
        text = self._name("t")
        self.writes.append(f'{text} = {place}.encode() + b"\\0"')
        self._numbers.append((f"len({text})", "I", "n"))
        piece = self._pack([text])
        self.writes.append(f"p += len({piece}) + len({text})")
        self.reads += [f"{value} = text_at(d, p, n)", "p += n"]

    def _pack(self, texts: list[str]) -> str:
        places, formats, values = zip(*self._numbers, strict=True)
        self._numbers.clear()
        structs, piece = self._name("s"), self._name("x")
        self.scope[structs] = aligned(self._order, "".join(formats))
        self.writes.append(f"{piece} = {structs}[p & 7].pack({', '.join(places)})")
        self.pieces += [f"{each}, " for each in (piece, *texts)]
        self.reads += [
            f"s = {structs}[p & 7]",
            f"{', '.join(values)}, = s.unpack_from(d, p)",
            "p += s.size",
        ]
        return piece

    def _sequence(self, field: MessageField, place: str, value: str) -> None:
        self.end_of_numbers()
        write, read, piece = self._name("w"), self._name("r"), self._name("x")
        self.scope[write], self.scope[read] = self._coders(field)
        self.writes += [f"{piece} = {write}({place}, p)", f"p += len({piece})"]
        self.pieces.append(f"{piece}, ")
        self.reads.append(f"{value}, p = {read}(d, p)")

    def _coders(self, field: MessageField) -> tuple[Writer, Reader]:
        if field.type == STRING:
            return of_texts(self._order)
        if field.type == "uint8":
            return of_bytes(self._order)
        if field.type in PRIMITIVES:
            return of_numbers(self._order, PRIMITIVES[field.type])
        return of_items(self._order, *layout_of(field.type, self._order))

    def _name(self, kind: str) -> str:
        self._names += 1
        return f"{kind}{self._names}"
