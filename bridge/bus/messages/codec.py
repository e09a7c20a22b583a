"""Messages to CDR bytes and back, by layouts that are compiled once from `msg/*.msg`.

The Zenoh encoding of a payload names its type (``application/cdr;lostlink_msgs/msg/Truth``), so that a reader
needs nothing but the sample.
"""

from __future__ import annotations

import struct
import typing
from typing import Final

from bridge.bus.messages.layout import CLASSES, layout_of
from bridge.bus.messages.types import Message

CDR: Final = "application/cdr"
HEADER_BYTES: Final = 4
_HEADER: Final = b"\0\1\0\0"
_ORDERS: Final = {b"\0\0": ">", b"\0\1": "<"}
_PADDING_MAX_BYTES: Final = 3
"""Some writers fill a payload up to a multiple of four bytes."""

M = typing.TypeVar("M", bound=Message)


class DecodeError(ValueError):
    """The payload is not a message of the type that its encoding names."""


def encoding_of(cls: type[Message]) -> str:
    """The Zenoh encoding of a message class."""
    return f"{CDR};{cls.TYPE}"


def encode(message: Message) -> bytes:
    """CDR bytes, little-endian, with the four-byte header (OMG DDSI-RTPS 10.2).

    Raises:
        ValueError: a number does not fit its field, or a text is none.
    """
    try:
        return _HEADER + layout_of(message.TYPE, "<").write(message, 0)
    except (struct.error, OverflowError) as error:
        raise ValueError(f"{message.TYPE} cannot be coded: {error}") from error


def decode(payload: bytes, cls: type[M]) -> M:
    """The message in ``payload``.

    Raises:
        DecodeError: if the bytes are not one.
    """
    order = _ORDERS.get(payload[:2])
    if order is None or len(payload) < HEADER_BYTES:
        raise DecodeError(f"not a {cls.TYPE}: {len(payload)} bytes without the header of CDR")
    data = payload[HEADER_BYTES:]
    try:
        message, end = layout_of(cls.TYPE, order).read(data, 0)
    except (struct.error, ValueError) as error:
        raise DecodeError(f"not a {cls.TYPE}: {error}") from error
    if end + _PADDING_MAX_BYTES < len(data):
        raise DecodeError(f"not a {cls.TYPE}: {len(data) - end} bytes too many")
    return typing.cast("M", message)


def class_of(encoding: str) -> type[Message] | None:
    """The message class that a Zenoh encoding names, or None if it is not one of ours."""
    media_type, _, name = encoding.partition(";")
    return CLASSES.get(name) if media_type == CDR else None
