"""How an agent wants a packet handled by its radio, and how that travels behind the stamp of what is transmitted."""

from __future__ import annotations

import struct
from numbers import Integral, Real
from typing import Final

from bridge.bus.session import Sample, Stamp
from channel.access.packets import PLAIN, Handling

__all__ = [
    "PLAIN",
    "Handling",
    "HandlingError",
    "handling_bytes",
    "handling_from_bytes",
    "handling_in",
    "handling_of",
]
_HEAD: Final = struct.Struct("<bqB")
"""Priority, life time in ns (-1: for ever), length of the key in UTF-8."""
KEY_MAX_BYTES: Final = 255
LIFETIME_MAX_S: Final = 1e6


class HandlingError(ValueError):
    """Bytes that do not say how a packet is to be handled."""


def handling_of(priority: int, lifetime_s: float | None, key: str) -> Handling:
    """What an agent asks for.

    Raises:
        ValueError: something that cannot be.
    """
    if priority == 0 and lifetime_s is None and not key:
        return PLAIN
    if not (isinstance(priority, Integral) and -128 <= priority <= 127):
        raise ValueError(f"priority={priority!r}: a whole number from -128 to 127")
    if lifetime_s is not None and not (isinstance(lifetime_s, Real) and 0.0 <= lifetime_s <= LIFETIME_MAX_S):
        raise ValueError(f"lifetime_s={lifetime_s!r}: from 0 to {LIFETIME_MAX_S:g} s")
    if not _is_key(key):
        raise ValueError(f"key={key!r}: a text of at most {KEY_MAX_BYTES} bytes in UTF-8")
    return Handling(int(priority), None if lifetime_s is None else round(float(lifetime_s) * 1e9), key)


def _is_key(key: object) -> bool:
    try:
        return isinstance(key, str) and len(key.encode()) <= KEY_MAX_BYTES
    except UnicodeEncodeError:  # half of a surrogate pair
        return False


def handling_bytes(handling: Handling) -> bytes:
    """As it travels; nothing for what is plain."""
    if handling == PLAIN:
        return b""
    key = handling.key.encode()
    lifetime_ns = -1 if handling.lifetime_ns is None else handling.lifetime_ns
    return _HEAD.pack(handling.priority, lifetime_ns, len(key)) + key


def handling_from_bytes(raw: bytes) -> Handling:
    """From what `handling_bytes` made.

    Raises:
        HandlingError: the bytes are none.
    """
    if not raw:
        return PLAIN
    if len(raw) < _HEAD.size:
        raise HandlingError(f"{len(raw)} bytes say nothing of how a packet is to be handled")
    priority, lifetime_ns, length = _HEAD.unpack_from(raw)
    key = raw[_HEAD.size :]
    if len(key) != length or lifetime_ns < -1:
        raise HandlingError(f"a key of {len(key)} bytes for {length}, or a life time of {lifetime_ns} ns")
    try:
        return Handling(priority, None if lifetime_ns < 0 else lifetime_ns, key.decode())
    except UnicodeDecodeError as error:
        raise HandlingError(f"a key that is no text in UTF-8: {error}") from error


def handling_in(sample: Sample) -> Handling:
    """Of a sample with a stamp.

    Raises:
        HandlingError: what stands behind the stamp is none.
    """
    raw = b"" if sample.attachment is None else sample.attachment.to_bytes()[Stamp.SIZE_BYTES :]
    return handling_from_bytes(raw)
