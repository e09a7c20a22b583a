"""Two payloads of one kind of stream that differ, said so that a person sees in what."""

from __future__ import annotations

from collections.abc import Callable
from itertools import zip_longest
from typing import Any, Final, NamedTuple

from aps.wire.dialect import message_fields, message_name
from aps.wire.framer import Frame, Framer
from bridge.record.logged import LoggedValue, decode_logged
from bridge.record.names import Kind
from bridge.record.packets import SentPacket, decode_packet

NOTHING: Final = "nothing"
TEXT_MAX: Final = 300
HEX_BYTES: Final = 16
_MAVLINK_FIELDS_ALWAYS: Final = ("seq", "sysid", "compid")


class Explained(NamedTuple):
    """What differs (a field, a message, a byte) and its value on either side."""

    what: str
    a: str
    b: str


def explain(kind: Kind, a: bytes, b: bytes, before: bytes = b"") -> Explained:
    """The first difference between two payloads that are not equal.

    Args:
        kind: of stream.
        a: payload of the one run.
        b: payload of the other.
        before: the end of what both streams had before; a MAVLink frame may have begun in it.
    """
    return _EXPLAINERS[kind](a, b, before)


def describe(kind: Kind, payload: bytes, before: bytes = b"") -> str:
    """A payload that the other side does not have."""
    if kind is Kind.PACKETS:
        try:
            packet = decode_packet(payload)
        except ValueError:
            return f"{len(payload)} bytes that are no packet"
        return f"packet {packet.seq} on channel {packet.channel}, {len(packet.payload)} bytes"
    if kind is Kind.LOGGED:
        return _short(_logged_text(payload))
    frames = _frames(payload, before)
    return _short(_frame_text(frames[0])) if frames else f"{len(payload)} bytes: {_hex(payload, 0)}"


def first_byte(a: bytes, b: bytes) -> Explained:
    """The first byte that differs, with those after it."""
    index = next((i for i, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))
    return Explained(f"byte {index}", _hex(a, index), _hex(b, index))


def _packet(a: bytes, b: bytes, _before: bytes) -> Explained:
    try:
        old, new = decode_packet(a), decode_packet(b)
    except ValueError:
        return first_byte(a, b)
    for name in ("seq", "address", "encoding", "sim_time_ns"):
        if getattr(old, name) != getattr(new, name):
            return Explained(name, str(getattr(old, name)), str(getattr(new, name)))
    what, left, right = first_byte(old.payload, new.payload)
    return Explained(f"packet {old.seq} on channel {old.channel}, {what}", *_lengths(old, new, left, right))


def _logged(a: bytes, b: bytes, _before: bytes) -> Explained:
    try:
        old, new = decode_logged(a), decode_logged(b)
    except ValueError:
        return first_byte(a, b)
    if isinstance(old, LoggedValue) and isinstance(new, LoggedValue) and old.name == new.name:
        return Explained(f"the value of {old.name}", _short(repr(old.value)), _short(repr(new.value)))
    return Explained("the entry", _short(_logged_text(a)), _short(_logged_text(b)))


def _logged_text(payload: bytes) -> str:
    try:
        item = decode_logged(payload)
    except ValueError as error:
        return str(error)
    return f"{item.name} = {item.value!r}" if isinstance(item, LoggedValue) else str(item)


def _lengths(old: SentPacket, new: SentPacket, left: str, right: str) -> tuple[str, str]:
    if len(old.payload) == len(new.payload):
        return left, right
    return f"{left} (of {len(old.payload)} bytes)", f"{right} (of {len(new.payload)} bytes)"


def _mavlink(a: bytes, b: bytes, before: bytes) -> Explained:
    for old, new in zip_longest(_frames(a, before), _frames(b, before)):
        if old is None or new is None:
            known = new if old is None else old
            texts = (_short(_frame_text(f)) if f is not None else NOTHING for f in (old, new))
            return Explained(message_name(known.msg_id), *texts)
        if old.raw != new.raw:
            return _frame_difference(old, new)
    return first_byte(a, b)


def _frames(payload: bytes, before: bytes) -> list[Frame]:
    """Frames that end within ``payload``."""
    framer = Framer(trusting=True)
    framer.receive(before)
    return framer.receive(payload)


def _frame_difference(old: Frame, new: Frame) -> Explained:
    if old.msg_id != new.msg_id:
        return Explained("message", _short(_frame_text(old)), _short(_frame_text(new)))
    left, right = _all_fields(old), _all_fields(new)
    names = [n for n in left if n in right and repr(left[n]) != repr(right[n])]
    if not names:
        what, *texts = first_byte(old.raw, new.raw)
        return Explained(f"{message_name(old.msg_id)}, {what}", *texts)
    texts = [_short(", ".join(f"{n} = {side[n]!r}" for n in names)) for side in (left, right)]
    return Explained(message_name(old.msg_id), *texts)


def _all_fields(frame: Frame) -> dict[str, Any]:
    fields = message_fields(frame.raw)
    return {name: getattr(frame, name) for name in _MAVLINK_FIELDS_ALWAYS} | fields


def _frame_text(frame: Frame) -> str:
    fields = ", ".join(f"{name} = {value!r}" for name, value in _all_fields(frame).items())
    return f"{message_name(frame.msg_id)}: {fields}"


def _hex(data: bytes, start: int) -> str:
    shown = data[start : start + HEX_BYTES]
    more = " ..." if len(data) > start + HEX_BYTES else ""
    return f"{shown.hex(' ')}{more}" if shown else f"{NOTHING} ({len(data)} bytes)"


def _short(text: str) -> str:
    return text if len(text) <= TEXT_MAX else f"{text[:TEXT_MAX]} ..."


_EXPLAINERS: Final[dict[Kind, Callable[[bytes, bytes, bytes], Explained]]] = {
    Kind.FROM_AUTOPILOT: _mavlink,
    Kind.TO_AUTOPILOT: _mavlink,
    Kind.TO_MODEM: _mavlink,
    Kind.FROM_MODEM: _mavlink,
    Kind.LOGGED: _logged,
    Kind.PACKETS: _packet,
}
