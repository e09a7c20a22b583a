"""MAVLink framing, by pymavlink: chunks of a client's bytes in, messages out; messages in, bytes out."""

from __future__ import annotations

import struct
from collections import Counter
from functools import partial
from typing import Any

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as dialect

COMPONENT = 1
"""MAV_COMP_ID_AUTOPILOT1."""
TRIM_BYTES = 4096
_HEAD = struct.Struct("<BBBBBBHB")
_CHECKSUM = struct.Struct("<H")

Message = Any
"""A pymavlink message (the dialect module has no types)."""


class MavlinkCodec:
    """One end of a MAVLink connection. Received bytes never raise; what is no message is counted."""

    def __init__(self, system: int) -> None:
        self.system = system
        self._seq = 0
        self.dropped: Counter[str] = Counter()
        """What came and was no message (``bad_data``, ``unknown_message``), or could not be packed
        (``unpackable``)."""
        self.reset()

    def reset(self) -> None:
        """Forget a frame begun: another client speaks."""
        self._receiver = dialect.MAVLink(None)
        self._receiver.robust_parsing = True

    def receive(self, data: bytes) -> list[Message]:
        """Take bytes; return the messages that they complete."""
        receiver = self._receiver
        messages = []
        for message in receiver.parse_buffer(data) or ():
            kind = message.get_type()
            if kind == "BAD_DATA":
                self.dropped["bad_data"] += 1
            elif kind.startswith("UNKNOWN_"):
                self.dropped["unknown_message"] += 1
            else:
                messages.append(message)
        if receiver.buf_index > TRIM_BYTES:  # pymavlink frees its buffer only when it is used up
            del receiver.buf[: receiver.buf_index]
            receiver.buf_index = 0
        return messages

    def pack(self, message: Message) -> bytes:
        """Return the frame of a message; empty if a value is beyond its field's range."""
        message._pack = partial(self._frame, message.get_msgId())
        try:
            frame: bytes = message.pack(None)
        except struct.error:  # physics far out of bounds
            self.dropped["unpackable"] += 1
            return b""
        self._seq = (self._seq + 1) & 0xFF
        return frame

    def _frame(self, number: int, _: object, crc_extra: int, payload: bytes, **__: object) -> bytes:
        """As pymavlink makes the frame of a message of this number, at a quarter of its cost."""
        kept = payload.rstrip(b"\0") or payload[:1]
        head = _HEAD.pack(len(kept), 0, 0, self._seq, self.system, COMPONENT, number & 0xFFFF, number >> 16)
        said = head + kept
        return b"\xfd" + said + _CHECKSUM.pack(mcrf4xx(said + bytes((crc_extra,))))
