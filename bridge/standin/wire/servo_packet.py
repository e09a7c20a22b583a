"""The servo packet that an autopilot sends to the physics: ``<HHI16H``, 40 bytes, magic 18458."""

from __future__ import annotations

import struct
from collections.abc import Sequence

MAGIC_16 = 18458
CHANNELS = 16
_PACKET = struct.Struct("<HHI16H")
LENGTH_BYTES = _PACKET.size


def pack_servo_packet(frame_rate_hz: int, frame_count: int, servo_output_us: Sequence[int]) -> bytes:
    """Encode one packet.

    Args:
        frame_rate_hz: rate at which the physics should step, 1..65535.
        frame_count: number of the frame; wraps at 2**32.
        servo_output_us: 16 PWM values in us, 0 = no output.
    """
    return _PACKET.pack(MAGIC_16, frame_rate_hz, frame_count & 0xFFFFFFFF, *servo_output_us)
