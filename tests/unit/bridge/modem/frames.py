"""MAVLink frames for tests, by pymavlink."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v10 import ardupilotmega as v1
from pymavlink.dialects.v20 import ardupilotmega as v2


def encoded(message: Any, seq: int = 0, *, version: int = 2, sysid: int = 1) -> bytes:
    """A frame of a message."""
    mav = v2.MAVLink(None, srcSystem=sysid, srcComponent=1)
    mav.seq = seq & 0xFF
    return bytes(message.pack(mav, force_mavlink1=version == 1))


def heartbeat(seq: int = 0, *, version: int = 2, sysid: int = 255) -> bytes:
    """HEARTBEAT of a ground station: 21 bytes with MAVLink 2, 17 with MAVLink 1."""
    return encoded(v2.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), seq, version=version, sysid=sysid)


def frame_of(length_bytes: int, seq: int) -> bytes:
    """A frame of so many bytes, 24 to 263: FILE_TRANSFER_PROTOCOL cut or filled, its number in it."""
    payload = [seq & 0xFF, seq >> 8 & 0xFF]
    filler = length_bytes - 12 - 3
    data = [*payload, *[1] * (filler - 2), *[0] * (251 - filler)]
    frame = encoded(v2.MAVLink_file_transfer_protocol_message(0, 1, 1, data), seq)
    assert len(frame) == length_bytes
    return frame


def decoded(data: bytes, *, version: int = 2) -> list[Any]:
    """All messages in a stream of bytes."""
    mav = (v2 if version == 2 else v1).MAVLink(None)
    mav.robust_parsing = True
    return mav.parse_buffer(data) or []
