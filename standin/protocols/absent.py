"""Answers to requests for what the stand-in has not: a client that is refused at once need not wait and ask again."""

from __future__ import annotations

import struct
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as dialect

from standin.wire.mavlink_codec import Message

ACK, NAK = 128, 129
UNKNOWN_COMMAND = 7
"""Of MAVLink's file transfer protocol: the opcodes of answers, and the error in a NAK."""
_HEAD = struct.Struct("<HBBBBBxI")
"""Sequence number, session, opcode, size, opcode that is answered, burst complete, offset."""
FILE_PAYLOAD_BYTES = 251
LOG_DATA_BYTES = 90


def handlers(send: Callable[[Message], None]) -> dict[str, Callable[[Message], None]]:
    """What to answer to each request."""
    return {
        "FILE_TRANSFER_PROTOCOL": lambda message: _refuse_files(message, send),
        "LOG_REQUEST_LIST": lambda _: send(dialect.MAVLink_log_entry_message(0, 0, 0, 0, 0)),
        "LOG_REQUEST_DATA": lambda message: send(
            dialect.MAVLink_log_data_message(message.id, message.ofs, 0, bytes(LOG_DATA_BYTES))
        ),
    }


def _refuse_files(message: Message, send: Callable[[Message], None]) -> None:
    seq, session, opcode, *_ = _HEAD.unpack_from(bytes(message.payload))
    if opcode >= ACK:  # an answer, and to answers there is none
        return
    head = _HEAD.pack((seq + 1) & 0xFFFF, session, NAK, 1, opcode, 0, 0)
    payload = (head + bytes([UNKNOWN_COMMAND])).ljust(FILE_PAYLOAD_BYTES, b"\0")
    sender = (message.get_srcSystem(), message.get_srcComponent())
    send(dialect.MAVLink_file_transfer_protocol_message(0, *sender, payload))
