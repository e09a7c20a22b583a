"""The autopilot's end of the physics exchange, without I/O: which frame counts, and what answers it.

The rules are SITL's: every sensor frame is answered by the next servo packet, and in silence the same packet
goes out again; time advances only by differences of ``timestamp``, and one that goes back is a reset of the
physics. A datagram that repeats the previous timestamp is a duplicate and is not answered: answering it would
leave a lag of one frame for ever. A servo packet is ``<HHI16H``, 40 bytes, magic 18458.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Sequence

from standin.wire.sensors import SensedFrame

MAGIC_16 = 18458
CHANNELS = 16
_PACKET = struct.Struct("<HHI16H")


class FdmLink:
    """Counts frames, keeps the simulation time and the latest packet."""

    def __init__(self, frame_rate_hz: int) -> None:
        self._frame_rate_hz = frame_rate_hz
        self._frame_count = 0
        self.fields: tuple[int, ...] = (MAGIC_16, frame_rate_hz, 0, *[0] * CHANNELS)
        """Those of the latest servo packet; the first one (frame 0, no output) opens the exchange."""
        self._timestamp_s: float | None = None
        self.sim_time_ns = 0
        """Time since boot: the sum of the timestamps' advances, the first one counting as an advance from
        0."""
        self.step_s = 0.0
        """How much the latest frame advanced the time; 0 after a reset of the physics."""
        self.events: Counter[str] = Counter()
        """``frames`` used, ``physics_resets``, and datagrams not used: ``malformed``, ``duplicate``."""

    @property
    def packet(self) -> bytes:
        """The latest servo packet."""
        return _PACKET.pack(*self.fields)

    def receive(self, frame: SensedFrame | None) -> bool:
        """Take what came, None if it was no frame; return whether the vehicle must step on it."""
        if frame is None:
            self.events["malformed"] += 1
            return False
        previous_s = self._timestamp_s
        advance_s = frame.timestamp_s - (previous_s or 0.0)
        if previous_s is not None and advance_s == 0.0:
            self.events["duplicate"] += 1
            return False
        if advance_s < 0.0:
            self.events["physics_resets"] += 1
            advance_s = 0.0
        self._timestamp_s = frame.timestamp_s
        self.step_s = advance_s
        self.sim_time_ns += round(advance_s * 1e9)
        self.events["frames"] += 1
        return True

    def answer(self, servo_output_us: Sequence[int]) -> None:
        """Make the next servo packet.

        Args:
            servo_output_us: 16 PWM values in us, 0 = no output.
        """
        self._frame_count = (self._frame_count + 1) & 0xFFFFFFFF
        self.fields = (MAGIC_16, self._frame_rate_hz, self._frame_count, *servo_output_us)
