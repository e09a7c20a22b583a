"""MAVLink framing, by pymavlink: chunks of a client's bytes in, messages out; messages in, bytes out."""

from __future__ import annotations

import struct
from collections import Counter
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

COMPONENT = 1
"""MAV_COMP_ID_AUTOPILOT1."""
TRIM_BYTES = 4096

Message = Any
"""A pymavlink message (the dialect module has no types)."""


class MavlinkCodec:
    """One end of a MAVLink connection. Received bytes never raise; what is no message is counted."""

    def __init__(self, system: int) -> None:
        self.system = system
        self._sender = dialect.MAVLink(None, system, COMPONENT)
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
        sender = self._sender
        try:
            frame = bytes(message.pack(sender))
        except struct.error:  # physics far out of bounds
            self.dropped["unpackable"] += 1
            return b""
        sender.seq = (sender.seq + 1) & 0xFF
        return frame
