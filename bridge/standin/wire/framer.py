"""MAVLink framing without I/O: any chunks of bytes in, messages out; what is not a good frame is counted."""

from __future__ import annotations

import struct
from collections import Counter
from typing import Any

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as dialect

MAGIC_1, MAGIC_2 = 0xFE, 0xFD
HEADER_1_BYTES, HEADER_2_BYTES = 6, 10
CRC_BYTES = 2
SIGNATURE_BYTES = 13
FLAG_SIGNED = 0x01

Message = Any
"""A pymavlink message (the dialect module has no types)."""


class Framer:
    """Cuts a byte stream into messages."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._codec = dialect.MAVLink(None)
        self.dropped: Counter[str] = Counter()
        """What was skipped, by reason: ``noise_bytes``, ``bad_crc``, ``unknown_message``, ``bad_flags``,
        ``undecodable``."""

    def reset(self) -> None:
        """Forget a frame begun: another client speaks."""
        self._buffer.clear()

    def receive(self, data: bytes) -> list[Message]:
        """Take bytes; return the messages that they complete."""
        buffer = self._buffer
        buffer += data
        messages: list[Message] = []
        start = 0
        while True:
            start = self._skip_noise(start)
            length = self._frame_length(start)
            if length is None or start + length > len(buffer):
                break
            frame = bytes(buffer[start : start + length])
            reason = _fault(frame)
            if reason is None:
                self._decode(frame, messages)
                start += length
            else:
                self.dropped[reason] += 1
                start += 1
        del buffer[:start]
        return messages

    def _skip_noise(self, start: int) -> int:
        buffer = self._buffer
        first = start
        while start < len(buffer) and buffer[start] != MAGIC_2 and buffer[start] != MAGIC_1:
            start += 1
        if start > first:
            self.dropped["noise_bytes"] += start - first
        return start

    def _frame_length(self, start: int) -> int | None:
        """Return the whole length of the frame that starts here, None if its header is not complete."""
        buffer = self._buffer
        if len(buffer) < start + 3:
            return None
        if buffer[start] == MAGIC_1:
            return HEADER_1_BYTES + buffer[start + 1] + CRC_BYTES
        signature = SIGNATURE_BYTES if buffer[start + 2] & FLAG_SIGNED else 0
        return HEADER_2_BYTES + buffer[start + 1] + CRC_BYTES + signature

    def _decode(self, frame: bytes, messages: list[Message]) -> None:
        try:
            messages.append(self._codec.decode(bytearray(frame)))
        except (dialect.MAVError, struct.error, ValueError, TypeError, IndexError):
            self.dropped["undecodable"] += 1


def _fault(frame: bytes) -> str | None:
    """Return why a frame is not good, None if it is."""
    if frame[0] == MAGIC_1:
        header, message_id = HEADER_1_BYTES, frame[5]
    else:
        header, message_id = HEADER_2_BYTES, int.from_bytes(frame[7:10], "little")
        if frame[2] & ~FLAG_SIGNED:
            return "bad_flags"
    message_class = dialect.mavlink_map.get(message_id)
    if message_class is None:
        return "unknown_message"
    end = header + frame[1]
    crc = mcrf4xx(frame[1:end] + bytes((message_class.crc_extra,)))
    return None if crc == int.from_bytes(frame[end : end + CRC_BYTES], "little") else "bad_crc"
