"""The servo packet: what ArduPilot's SITL sends to its external physics, one per simulation frame.

Little-endian, no padding (ArduPilot ``SIM_JSON.h``, ``servo_packet_16`` and ``servo_packet_32``):

    offset  0  uint16  magic        18458 with 16 channels, 29569 with 32 (SERVO_32_ENABLE = 1)
            2  uint16  frame_rate   Hz, the rate at which the autopilot wants to be stepped
            4  uint32  frame_count  number of replies that the autopilot has taken since its boot
            8  uint16  pwm[16|32]   us; 0 = no output on that channel
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

MAGIC_16 = 18458
MAGIC_32 = 29569
SIZE_16_BYTES = 40
SIZE_32_BYTES = 72
FRAME_RATE_MIN_HZ = 10
"""Slower rates are refused: ArduPilot ignores steps of 0.1 s and longer."""
FRAME_COUNT_MODULUS = 1 << 32

_STRUCT_16 = struct.Struct("<HHI16H")
_STRUCT_32 = struct.Struct("<HHI32H")
_unpack_16 = _STRUCT_16.unpack
_unpack_32 = _STRUCT_32.unpack

Fields = tuple[int, ...]
"""(magic, frame_rate_hz, frame_count, pwm_1_us, pwm_2_us, ...): the packet as unpacked, 19 or 35 integers."""
PWM_OFFSET = 3
"""Index of channel 1 in `Fields`; channel n is at PWM_OFFSET + n - 1."""


@dataclass(frozen=True, slots=True)
class ServoPacket:
    """One servo packet.

    Attributes:
        frame_rate_hz: rate the autopilot wants, 10 to 65535.
        frame_count: 0 to 2**32 - 1.
        servo_output_us: 16 or 32 pulse widths, 0 to 65535; 0 = no output.
    """

    frame_rate_hz: int
    frame_count: int
    servo_output_us: tuple[int, ...]


def encode_servo_packet(packet: ServoPacket) -> bytes:
    """The datagram of `packet`.

    Raises:
        ValueError: the number of channels is neither 16 nor 32, or a value does not fit its field.
    """
    channels = len(packet.servo_output_us)
    if channels not in (16, 32):
        raise ValueError(f"{channels} channels: a servo packet has 16 or 32")
    layout, magic = (_STRUCT_16, MAGIC_16) if channels == 16 else (_STRUCT_32, MAGIC_32)
    try:
        return layout.pack(magic, packet.frame_rate_hz, packet.frame_count, *packet.servo_output_us)
    except struct.error as error:
        raise ValueError(f"{packet}: {error}") from None


def unpack_servo_packet(datagram: bytes) -> Fields | str:
    """Take a datagram apart, cheaply: this is on the hot path.

    Args:
        datagram: bytes of any length and content.

    Returns:
        The fields, or the reason why this is no servo packet: ``bad_length``, ``bad_magic``,
        ``bad_frame_rate``. Never raises.
    """
    size = len(datagram)
    if size == SIZE_16_BYTES:
        fields, magic = _unpack_16(datagram), MAGIC_16
    elif size == SIZE_32_BYTES:
        fields, magic = _unpack_32(datagram), MAGIC_32
    else:
        return "bad_length"
    if fields[0] != magic:
        return "bad_magic"
    return fields if fields[1] >= FRAME_RATE_MIN_HZ else "bad_frame_rate"


DROP_REASONS = ("bad_length", "bad_magic", "bad_frame_rate")
