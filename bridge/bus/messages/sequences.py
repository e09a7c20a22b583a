"""Strings and sequences in CDR (XCDR1, OMG DDS-XTYPES 7.4), for the layouts that are compiled from definitions.

Positions are counted from the end of the encapsulation header; CDR aligns each number to its size. What reads raises
`Malformed`, `struct.error` or UnicodeDecodeError for bytes that are none.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, Final

ALIGNMENT_MAX: Final = 8
Writer = Callable[[Any, int], bytes]
"""The bytes of a value that begins at a position."""
Reader = Callable[[bytes, int], tuple[Any, int]]
"""The value at a position, and the position behind it."""


class Malformed(ValueError):
    """Bytes that are no such message."""


@cache
def aligned(order: str, formats: str) -> tuple[struct.Struct, ...]:
    """Numbers that follow each other, of the given formats: a struct for each position modulo 8 that they begin at."""
    return tuple(struct.Struct(order + _padded(formats, start)) for start in range(ALIGNMENT_MAX))


def _padded(formats: str, position: int) -> str:
    found = ""
    for each in formats:
        size = struct.calcsize("=" + each)
        padding = -position % size
        found += "x" * padding + each
        position += padding + size
    return found


def text_at(data: bytes, position: int, length: int) -> str:
    """The string of ``length`` bytes, with its final zero, at ``position``."""
    end = position + length
    if length < 1 or end > len(data) or data[end - 1]:
        raise Malformed(f"no string of {length} bytes at {position}")
    return data[position : end - 1].decode()


def _count_at(data: bytes, position: int, structs: Sequence[struct.Struct]) -> tuple[int, int]:
    each = structs[position & 7]
    (count,) = each.unpack_from(data, position)
    position += each.size
    if count > len(data) - position:
        raise Malformed(f"no sequence of {count} items at {position}")
    return count, position


def of_bytes(order: str) -> tuple[Writer, Reader]:
    """Sequences of bytes."""
    counts = aligned(order, "I")

    def write(items: Any, position: int) -> bytes:
        return counts[position & 7].pack(len(items)) + bytes(items)

    def read(data: bytes, position: int) -> tuple[Any, int]:
        count, position = _count_at(data, position, counts)
        return data[position : position + count], position + count

    return write, read


def of_numbers(order: str, kind: str) -> tuple[Writer, Reader]:
    """Sequences of numbers of one format; an array of numpy is written by its memory."""
    counts, size = aligned(order, "I"), struct.calcsize("=" + kind)

    def write(items: Any, position: int) -> bytes:
        head = counts[position & 7].pack(len(items))
        if not len(items):
            return head
        padding = -(position + len(head)) % size
        if hasattr(items, "astype"):
            packed: bytes = items.astype(f"{order}{kind}", casting="same_kind", copy=False).tobytes()
            return head + bytes(padding) + packed
        return head + struct.pack(f"{order}{padding}x{len(items)}{kind}", *items)

    def read(data: bytes, position: int) -> tuple[Any, int]:
        count, position = _count_at(data, position, counts)
        if count:
            position += -position % size
        return struct.unpack_from(f"{order}{count}{kind}", data, position), position + count * size

    return write, read


def of_texts(order: str) -> tuple[Writer, Reader]:
    """Sequences of strings."""
    counts = aligned(order, "I")

    def write(item: Any, position: int) -> bytes:
        text: bytes = item.encode() + b"\0"
        return counts[position & 7].pack(len(text)) + text

    def read(data: bytes, position: int) -> tuple[Any, int]:
        each = counts[position & 7]
        (length,) = each.unpack_from(data, position)
        position += each.size
        return text_at(data, position, length), position + length

    return of_items(order, write, read)


def of_items(order: str, write_item: Writer, read_item: Reader) -> tuple[Writer, Reader]:
    """Sequences of what has no fixed length."""
    counts = aligned(order, "I")

    def write(items: Any, position: int) -> bytes:
        parts = [counts[position & 7].pack(len(items))]
        position += len(parts[0])
        for item in items:
            parts.append(write_item(item, position))
            position += len(parts[-1])
        return b"".join(parts)

    def read(data: bytes, position: int) -> tuple[Any, int]:
        count, position = _count_at(data, position, counts)
        found = []
        for _ in range(count):
            item, position = read_item(data, position)
            found.append(item)
        return tuple(found), position

    return write, read
