"""MAVLink frames as a stream of bytes: written, and found again. Sans-IO; version 2, and version 1 is read too.

https://mavlink.io/en/guide/serialization.html. Little-endian:

    version 2   0xFD, length, incompatible flags, compatible flags, sequence, system, component, message id (3 bytes),
                payload less its trailing zeros, checksum (2 bytes), signature (13 bytes, if flag 1 says so)
    version 1   0xFE, length, sequence, system, component, message id, payload, checksum

The checksum is CRC-16/MCRF4XX over everything after the first byte and, last, a byte that stands for the message's
definition (CRC_EXTRA).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping

from fastcrc.crc16 import mcrf4xx

MAGIC_2, MAGIC_1 = 0xFD, 0xFE
_MAGIC = re.compile(rb"[\xfd\xfe]")
_HEADER_2, _HEADER_1, _CHECKSUM, _SIGNATURE = 10, 6, 2, 13
_SIGNED = 0x01


class FrameWriter:
    """Writes frames of one sender, with its sequence number.

    Args:
        system, component: MAVLink ids of the sender, 0 to 255.
    """

    __slots__ = ("_component", "_sequence", "_system")

    def __init__(self, system: int, component: int) -> None:
        self._system, self._component, self._sequence = system, component, 0

    def frame(self, message_id: int, crc_extra: int, payload: bytes) -> bytes:
        """The next frame.

        Args:
            message_id: 0 to 2**24 - 1.
            crc_extra: of the message's definition.
            payload: 1 to 255 bytes, its trailing zeros included.
        """
        payload = payload.rstrip(b"\0") or b"\0"
        body = bytes((len(payload), 0, 0, self._sequence, self._system, self._component))
        body += message_id.to_bytes(3, "little") + payload
        self._sequence = (self._sequence + 1) & 0xFF
        return b"\xfd" + body + mcrf4xx(body + bytes((crc_extra,))).to_bytes(2, "little")


class FrameReader:
    """Finds frames in a stream of bytes, however it is cut.

    Args:
        known: CRC_EXTRA of the messages that are wanted, by id; others are passed over by their length.

    Attributes:
        counters: what was dropped: bad_checksum, noise_bytes, other_messages.
    """

    __slots__ = ("_known", "_left", "counters")

    def __init__(self, known: Mapping[int, int]) -> None:
        self._known = known
        self._left = b""
        self.counters: Counter[str] = Counter()

    def feed(self, data: bytes) -> list[tuple[int, bytes]]:
        """Take bytes; returns id and payload of the wanted messages that are whole now. Never raises."""
        data = self._left + data
        found: list[tuple[int, bytes]] = []
        at = 0
        while at < len(data):
            begin = _MAGIC.search(data, at)
            if begin is None or begin.start() > at:
                end = len(data) if begin is None else begin.start()
                self.counters["noise_bytes"] += end - at
                at = end
                continue
            size = _frame_size(data, at)
            if not size or at + size > len(data):
                break
            at += self._take(data[at : at + size], found)
        self._left = data[at:]
        return found

    def _take(self, frame: bytes, found: list[tuple[int, bytes]]) -> int:
        """Read a whole frame; returns how many bytes are done with."""
        is_2 = frame[0] == MAGIC_2
        begin = _HEADER_2 if is_2 else _HEADER_1
        end = begin + frame[1]
        message_id = int.from_bytes(frame[7:10], "little") if is_2 else frame[5]
        extra = self._known.get(message_id)
        if extra is None:
            self.counters["other_messages"] += 1
            return len(frame)
        if mcrf4xx(frame[1:end] + bytes((extra,))) != int.from_bytes(frame[end : end + 2], "little"):
            self.counters["bad_checksum"] += 1
            return 1
        found.append((message_id, frame[begin:end]))
        return len(frame)


def _frame_size(data: bytes, at: int) -> int:
    """Length of the frame that begins at `at`; 0 while too few bytes are there to tell."""
    if data[at] == MAGIC_1:
        return _HEADER_1 + data[at + 1] + _CHECKSUM if len(data) > at + 1 else 0
    if len(data) <= at + 2:
        return 0
    return _HEADER_2 + data[at + 1] + _CHECKSUM + (_SIGNATURE if data[at + 2] & _SIGNED else 0)
