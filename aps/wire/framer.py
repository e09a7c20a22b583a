"""MAVLink 1 and 2 framing on raw bytes, without I/O.

    framer = Framer()
    for frame in framer.receive(data): ...

Bytes go in in any chunking, whole frames with a good checksum come out, with their original bytes.
What is not a frame is skipped byte by byte up to the next start marker and counted by reason; nothing
raises. Payloads are not decoded here.

Layout (MAVLink "Packet Serialization"): v1 ``FE len seq sys comp id8`` payload crc16;
v2 ``FD len incompat compat seq sys comp id24`` payload crc16 [signature 13 bytes].
The checksum is CRC-16/MCRF4XX over all but the start marker, and one byte from the message's definition.

An id that the tables lack has no such byte, but exactly 256 of the 65536 checksums can be had with *some*
byte: one of 256 pieces of garbage that look like an unknown message would pass. So an unknown message is believed,
and routed, only with evidence: its checksum is one of these, and its sender has been heard on this stream before
with a message that the tables have.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

from fastcrc.crc16 import mcrf4xx

from aps.wire.dialect import CRC_EXTRA, TARGET_OFFSETS

MAGIC_V1: Final = 0xFE
MAGIC_V2: Final = 0xFD
HEADER_V1_BYTES: Final = 6
HEADER_V2_BYTES: Final = 10
CRC_BYTES: Final = 2
SIGNATURE_BYTES: Final = 13
INCOMPAT_SIGNED: Final = 0x01
MAX_FRAME_BYTES: Final = HEADER_V2_BYTES + 255 + CRC_BYTES + SIGNATURE_BYTES

MAX_SENDERS: Final = 256
"""Bound on remembered senders; beyond it all are forgotten."""

# Only what framing needs: length, [incompat,] sysid, compid, message id.
_HEADER_V1: Final = struct.Struct("<xBxBBB")
_HEADER_V2: Final = struct.Struct("<xBBxxBBHB")
_CRC: Final = struct.Struct("<H")
_DEFINITIONS: Final = {
    msg_id: (extra, *TARGET_OFFSETS.get(msg_id, (-1, -1))) for msg_id, extra in CRC_EXTRA.items()
}
_UNKNOWN: Final = (b"", -1, -1)


def _crc_step(value: int) -> int:
    """What one more byte does to the shifted checksum; ``value`` is the byte XOR the checksum's low half."""
    value ^= (value << 4) & 0xFF
    return ((value << 8) ^ (value << 3) ^ (value >> 4)) & 0xFFFF


_CRC_STEPS: Final = frozenset(_crc_step(value) for value in range(256))


class Frame(NamedTuple):
    """One MAVLink frame as it came; ``raw`` is what gets forwarded."""

    raw: bytes
    msg_id: int
    sysid: int
    compid: int
    target_system: int
    """0 when the message has no target, or addresses everybody."""
    target_component: int
    payload_start: int
    """Offset of the payload in ``raw``: 6 for MAVLink 1, 10 for MAVLink 2."""
    payload_bytes: int

    @property
    def payload(self) -> bytes:
        """The payload as sent (MAVLink 2 trims trailing zeros)."""
        return self.raw[self.payload_start : self.payload_start + self.payload_bytes]

    @property
    def seq(self) -> int:
        """The sender's sequence number, 0..255."""
        return self.raw[4] if self.raw[0] == MAGIC_V2 else self.raw[2]

    @property
    def signed(self) -> bool:
        """Whether a MAVLink 2 signature follows the checksum (it is passed on, not verified)."""
        return self.raw[0] == MAGIC_V2 and bool(self.raw[2] & INCOMPAT_SIGNED)


@dataclass(slots=True)
class FramerCounters:
    """What became of the bytes. ``frames`` counts all that came out; the next three are parts of it."""

    frames: int = 0
    frames_v1: int = 0
    signed: int = 0
    unknown_id: int = 0
    unknown_sender: int = 0
    """Start markers of unknown messages whose sender had not been heard before."""
    bad_crc: int = 0
    """Start markers whose frame had a wrong checksum."""
    bad_flags: int = 0
    """MAVLink 2 start markers with incompatibility flags that nobody has defined."""
    skipped_bytes: int = 0
    """Bytes that belong to no frame."""


class Framer:
    """Cuts one byte stream into frames. Keeps at most one incomplete frame (280 bytes) between calls.

    Args:
        trusting: whether an unknown message is believed without having heard its sender: for bytes that are known
            to be frames, those of a record for one.
    """

    __slots__ = ("_pending", "_senders", "_trusting", "counters")

    def __init__(self, *, trusting: bool = False) -> None:
        self._trusting = trusting
        self.counters = FramerCounters()
        self._pending = b""
        self._senders: set[int] = set()
        """sysid << 8 | compid of senders of known messages."""

    @property
    def pending_bytes(self) -> int:
        """Bytes held back as the possible beginning of a frame."""
        return len(self._pending)

    def reset(self) -> None:
        """Forget an incomplete frame (the stream begins anew, e.g. after a reconnect)."""
        self.counters.skipped_bytes += len(self._pending)
        self._pending = b""
        self._senders.clear()

    def _heard(self, sender: int) -> None:
        if len(self._senders) >= MAX_SENDERS:
            self._senders.clear()
        self._senders.add(sender)

    def receive(self, data: bytes) -> list[Frame]:
        """Take the next bytes of the stream and return the frames that they complete, in order."""
        buffer = self._pending + data if self._pending else bytes(data)
        frames: list[Frame] = []
        position = self._take(buffer, frames.append)
        self._pending = self._keep(buffer, position)
        self.counters.frames += len(frames)
        return frames

    def _take(self, buffer: bytes, append: Callable[[Frame], None]) -> int:
        """Append whole frames; returns up to where. The whole cost of a message: inline, no calls of our own."""
        position, end = 0, len(buffer)
        senders, unpack_v2, definition_of = self._senders, _HEADER_V2.unpack_from, _DEFINITIONS.get
        while end - position >= HEADER_V1_BYTES + CRC_BYTES:
            magic = buffer[position]
            if magic == MAGIC_V2:
                if end - position < HEADER_V2_BYTES + CRC_BYTES:
                    break
                length, incompat, sysid, compid, id_low, id_high = unpack_v2(buffer, position)
                msg_id = id_low | id_high << 16
                header = HEADER_V2_BYTES
                size = HEADER_V2_BYTES + CRC_BYTES + length
                if incompat:
                    if incompat != INCOMPAT_SIGNED:
                        self.counters.bad_flags += 1
                        position = self._skip(buffer, position)
                        continue
                    size += SIGNATURE_BYTES
            elif magic == MAGIC_V1:
                length, sysid, compid, msg_id = _HEADER_V1.unpack_from(buffer, position)
                header = HEADER_V1_BYTES
                size = HEADER_V1_BYTES + CRC_BYTES + length
                incompat = 0
            else:
                position = self._skip(buffer, position)
                continue
            if end - position < size:
                break
            raw = buffer[position : position + size]
            crc_at = header + length
            extra, at_system, at_component = definition_of(msg_id, _UNKNOWN)
            received = raw[crc_at] | raw[crc_at + 1] << 8
            if extra:
                good = mcrf4xx(raw[1:crc_at] + extra) == received
                if good and sysid << 8 | compid not in senders:
                    self._heard(sysid << 8 | compid)
            elif sysid << 8 | compid not in senders and not self._trusting:
                self.counters.unknown_sender += 1
                position = self._skip(buffer, position)
                continue
            else:
                good = _could_be_crc(raw[1:crc_at], received)
                self.counters.unknown_id += good
            if not good:
                self.counters.bad_crc += 1
                position = self._skip(buffer, position)
                continue
            target_system = target_component = 0
            if at_system >= 0:
                target_system = raw[header + at_system] if at_system < length else 0
                target_component = raw[header + at_component] if 0 <= at_component < length else 0
            fields = (raw, msg_id, sysid, compid, target_system, target_component, header, length)
            append(_new_frame(Frame, fields))
            if incompat:
                self.counters.signed += 1
            if magic == MAGIC_V1:
                self.counters.frames_v1 += 1
            position += size
        return position

    def _skip(self, buffer: bytes, position: int) -> int:
        """The next start marker after ``position`` (or the end), counting what is passed over."""
        start = _next_magic(buffer, position + 1)
        self.counters.skipped_bytes += start - position
        return start

    def _keep(self, buffer: bytes, position: int) -> bytes:
        """The tail that may become a frame; what cannot is dropped at once."""
        if position < len(buffer) and buffer[position] not in (MAGIC_V1, MAGIC_V2):
            position = self._skip(buffer, position)
        return buffer[position:]


_new_frame = tuple.__new__


def _next_magic(buffer: bytes, start: int) -> int:
    """Index of the first start marker from ``start`` on, or the buffer's length."""
    v2 = buffer.find(MAGIC_V2, start)
    v1 = buffer.find(MAGIC_V1, start, v2 if v2 >= 0 else len(buffer))
    if v1 >= 0:
        return v1
    return v2 if v2 >= 0 else len(buffer)


def _could_be_crc(covered: bytes, received: int) -> bool:
    """Whether some definition byte after ``covered`` gives the received checksum."""
    crc: int = mcrf4xx(covered)
    return received ^ (crc >> 8) in _CRC_STEPS


def with_payload(frame: Frame, payload: bytes) -> bytes:
    """The same MAVLink frame (sender, sequence, id) with another payload and a fresh checksum.

    Args:
        frame: an unsigned frame with a known message id.
        payload: full or trimmed payload; trailing zeros are trimmed for MAVLink 2.

    Raises:
        ValueError: the frame is signed (we lack the key) or of an unknown id (we lack its CRC_EXTRA).
    """
    extra = CRC_EXTRA.get(frame.msg_id)
    if extra is None or frame.signed:
        raise ValueError(f"message {frame.msg_id} cannot be rewritten: unknown id, or signed")
    if frame.raw[0] == MAGIC_V2:
        payload = payload.rstrip(b"\0") or b"\0"
    body = bytes([len(payload)]) + frame.raw[2 : frame.payload_start] + payload
    return frame.raw[:1] + body + _CRC.pack(mcrf4xx(body + extra))
