"""The autopilot's end of the physics exchange, without I/O: which frame counts, and when to send again.

The rules are SITL's: every sensor frame is answered by the next servo packet; after about 1.1 s of silence
the same packet goes out again; time advances only by differences of ``timestamp``, and one that goes back is
a reset of the physics. A datagram that repeats the previous timestamp is a duplicate and is not answered:
answering it would leave a lag of one frame for ever.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from bridge.standin.wire.sensors import SensorFrame, parse_sensor_frame
from bridge.standin.wire.servo_packet import CHANNELS, pack_servo_packet

RESEND_AFTER_S = 1.1
"""Wall time without a sensor frame after which the last servo packet is sent again."""


class FdmLink:
    """Counts frames, keeps the simulation time, and remembers the last packet."""

    def __init__(self, frame_rate_hz: int) -> None:
        self._frame_rate_hz = frame_rate_hz
        self._frame_count = 0
        self._packet = pack_servo_packet(frame_rate_hz, 0, [0] * CHANNELS)
        self._sent_at_s = 0.0
        self._timestamp_s: float | None = None
        self.sim_time_ns = 0
        """Time since boot: the sum of the timestamps' advances, the first one counting as an advance from
        0."""
        self.step_s = 0.0
        """How much the latest frame advanced the time; 0 after a reset of the physics."""
        self.dropped: Counter[str] = Counter()
        """Datagrams that were not used, by reason: ``malformed``, ``duplicate``."""
        self.events: Counter[str] = Counter()
        """``frames`` used, packets ``resent``, ``physics_resets``."""

    @property
    def frame_count(self) -> int:
        """Number of the latest packet."""
        return self._frame_count

    def receive(self, datagram: bytes) -> SensorFrame | None:
        """Take one datagram; return its frame if the vehicle must step on it."""
        frame = parse_sensor_frame(datagram)
        if frame is None:
            self.dropped["malformed"] += 1
            return None
        previous_s = self._timestamp_s
        advance_s = frame.timestamp_s - (previous_s or 0.0)
        if previous_s is not None and advance_s == 0.0:
            self.dropped["duplicate"] += 1
            return None
        if advance_s < 0.0:
            self.events["physics_resets"] += 1
            advance_s = 0.0
        self._timestamp_s = frame.timestamp_s
        self.step_s = advance_s
        self.sim_time_ns += round(advance_s * 1e9)
        self.events["frames"] += 1
        return frame

    def answer(self, servo_output_us: Sequence[int], now_s: float) -> bytes:
        """Return the next servo packet.

        Args:
            servo_output_us: 16 PWM values in us.
            now_s: wall time (monotonic) at which it is sent.
        """
        self._frame_count = (self._frame_count + 1) & 0xFFFFFFFF
        self._packet = pack_servo_packet(self._frame_rate_hz, self._frame_count, servo_output_us)
        self._sent_at_s = now_s
        return self._packet

    def start(self, now_s: float) -> bytes:
        """Return the packet that opens the exchange (frame 0, no output)."""
        self._sent_at_s = now_s
        return self._packet

    def deadline_s(self) -> float:
        """Return the wall time (monotonic) at which ``resend`` is due."""
        return self._sent_at_s + RESEND_AFTER_S

    def resend(self, now_s: float) -> bytes:
        """Return the last packet again, same frame count."""
        self._sent_at_s = now_s
        self.events["resent"] += 1
        return self._packet
