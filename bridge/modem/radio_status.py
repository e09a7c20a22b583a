"""RADIO_STATUS (109) as the firmware of modems fills it in, for the host at their own serial line."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final, Protocol

from fastcrc.crc16 import mcrf4xx

from aps.wire.dialect import CRC_EXTRA
from aps.wire.framer import Frame
from bridge.modem.heard import RadioMeter
from bridge.modem.units import MAGIC_V1, MAGIC_V2, Unit

RADIO_STATUS: Final = 109
COMPID: Final = 68
SIK_SYSID, ELRS_SYSID = 51, 255
REMOTE_LASTS_NS: Final = 6 * 513_600_000
"""SiK forgets what its peer said after six looks at the link, 0.5136 s each, without a packet."""
ELRS_PERIOD_NS: Final = 11_000_000
"""More than 10 ms by a clock of milliseconds."""
_PAYLOAD: Final = struct.Struct("<HHBBBBB")
_CRC: Final = struct.Struct("<H")


@dataclass(frozen=True, slots=True)
class Buffer:
    """How full a modem's buffer from its host is."""

    used_bytes: int
    size_bytes: int


class ModemStatus(Protocol):
    """When a kind of modem says how its link is, and what."""

    period_ns: int
    """Between two of them; 0: only after a frame of the host."""

    def answers(self, unit: Unit) -> bool:
        """Whether a unit of its host that was on the air is followed by one."""

    def frame(self, version: int, seq: int, heard: RadioMeter, buffer: Buffer, now_ns: int) -> bytes:
        """The frame, in the version of MAVLink that the host speaks."""


def is_status(frame: Frame) -> bool:
    """Whether a frame is a modem's RADIO_STATUS."""
    return frame.msg_id == RADIO_STATUS and frame.compid == COMPID


class SikStatus:
    """SiK 2.2 (`mavlink.c`): after each HEARTBEAT of the host that was on the air, while it frames MAVLink."""

    period_ns = 0

    def answers(self, unit: Unit) -> bool:
        """To a HEARTBEAT."""
        return unit.is_heartbeat

    def frame(self, version: int, seq: int, heard: RadioMeter, buffer: Buffer, now_ns: int) -> bytes:
        """`serial_read_space` reckons in eighths; what the peer said is forgotten after some 3 s without a packet."""
        free_bytes = max(buffer.size_bytes - buffer.used_bytes, 0)
        free_percent = min(100 * (free_bytes // 8) // max(buffer.size_bytes // 8, 1), 100)
        is_fresh = heard.heard_ns is not None and now_ns - heard.heard_ns < REMOTE_LASTS_NS
        remote_rssi, remote_noise = heard.remote if is_fresh else (0, 0)
        # corrected packets are not known here: the channel says only whether a frame came through
        fields = (heard.errors, 0, heard.rssi, remote_rssi, free_percent, heard.noise, remote_noise)
        return _packed(version, seq, SIK_SYSID, _PAYLOAD.pack(*fields))


class ElrsStatus:
    """ExpressLRS 7702d0f (`SerialMavlink.cpp`): some 90 times a second, by the receiver alone, in MAVLink 2."""

    period_ns = ELRS_PERIOD_NS

    def answers(self, unit: Unit) -> bool:  # noqa: ARG002 (it follows its clock)
        """To nothing."""
        return False

    def frame(self, version: int, seq: int, heard: RadioMeter, buffer: Buffer, now_ns: int) -> bytes:  # noqa: ARG002
        """Link quality, and powers of the way up without their sign."""
        free_percent = max(buffer.size_bytes - buffer.used_bytes, 0) * 100 // buffer.size_bytes
        quality_percent = 100 * sum(heard.quality) // max(len(heard.quality), 1)
        power, snr = (0, 0) if heard.heard_ns is None else (round(-heard.power_dbm), round(heard.snr_db))
        fields = (0, 0, int(quality_percent * 2.55), min(max(power, 0), 255), free_percent, snr & 0xFF, 0)
        payload = _PAYLOAD.pack(*fields).rstrip(b"\0") or b"\0"
        return _packed(2, seq, ELRS_SYSID, payload)


def _packed(version: int, seq: int, sysid: int, payload: bytes) -> bytes:
    seq &= 0xFF
    if version == 1:
        head = bytes([len(payload), seq, sysid, COMPID, RADIO_STATUS])
        magic = MAGIC_V1
    else:
        head = bytes([len(payload), 0, 0, seq, sysid, COMPID]) + RADIO_STATUS.to_bytes(3, "little")
        magic = MAGIC_V2
    body = head + payload
    return bytes([magic]) + body + _CRC.pack(mcrf4xx(body + CRC_EXTRA[RADIO_STATUS]))
