"""When a frame that was sent to PX4 is done. Sans-IO: bytes, instants and whether PX4 is at rest come in.

A frame is done when PX4 has answered it, or when it is at rest and so cannot answer any more: then it keeps its
outputs. While PX4 boots (its start script runs), and at ticks, an answered frame is done only when PX4 is at rest,
too: what the frame has set going is over, and all that PX4 says over MAVLink is said.
"""

from __future__ import annotations

from collections import Counter

from fdm.wire.px4.hil import CONTROLS, FROM_PX4, ActuatorControls, pulse_widths, read_actuators
from fdm.wire.px4.mavlink import FrameReader
from fdm.wire.servo_packet import Fields

PATIENCE_NS = 20_000_000
"""Wall time after which it is looked whether PX4 will answer at all. Nothing but wall time depends on it."""
_IDLE = (0.0,) * CONTROLS


class FramesOfPx4:
    """The frames of one connection.

    Args:
        rate_hz: frames per second.
        motors: outputs that are motors.
        sees_rest: whether it can be seen if PX4 is at rest; if not, patience decides, which is wall time.

    Attributes:
        counters: what was dropped, and frames without an answer.
        booted: PX4's start script has ended.
    """

    def __init__(self, rate_hz: int, motors: frozenset[int], *, sees_rest: bool = True) -> None:
        self._rate_hz, self._motors, self._sees_rest = rate_hz, motors, sees_rest
        self._reader = FrameReader(FROM_PX4)
        self._awaited = -1
        self._sent_ns = 0
        self._answer: ActuatorControls | None = None
        self._controls: tuple[float, ...] = _IDLE
        self._holds = True
        self.booted = False
        self.counters: Counter[str] = Counter()

    def hello(self) -> Fields:
        """PX4 has connected: it wants the first frame."""
        return self._fields(0)

    def sent(self, frame: int, wall_ns: int, *, holds: bool) -> None:
        """Frame `frame` (counted from 1) was sent.

        Args:
            frame: which.
            wall_ns: monotonic wall time.
            holds: whether it is done only when PX4 is at rest.
        """
        self._awaited, self._sent_ns, self._answer, self._holds = frame, wall_ns, None, holds

    def receive(self, data: bytes) -> None:
        """Take what PX4 sent. Never raises."""
        for _, payload in self._reader.feed(data):
            answer = read_actuators(payload)
            if answer is None:
                self.counters["bad_controls"] += 1
            elif self._number(answer) != self._awaited or self._answer is not None:
                self.counters["answers_not_asked_for"] += 1
            else:
                self._answer = answer

    def done(self) -> Fields | None:
        """The frame that is done, as a packet that asks for the next one; None if there is none."""
        if self._answer is None or self._needs_rest:
            return None
        return self._finish()

    def wants_rest(self, wall_ns: int) -> bool:
        """Whether it is to be looked if PX4 is at rest; where that cannot be seen, whether patience has run out."""
        if self._awaited < 0:
            return False
        return self._needs_rest or wall_ns - self._sent_ns >= PATIENCE_NS

    def at_rest(self) -> Fields:
        """PX4 is at rest: the frame is done, answered or not. To be called if `wants_rest` only."""
        if self._answer is None:
            self.counters["frames_unanswered"] += 1
        return self._finish()

    @property
    def _needs_rest(self) -> bool:
        return self._sees_rest and (self._holds or not self.booted)

    def _finish(self) -> Fields:
        frame, self._awaited = self._awaited, -1
        if self._answer is not None:
            self._controls = self._answer.controls
        return self._fields(frame)

    def _fields(self, frame: int) -> Fields:
        return (0, self._rate_hz, frame, *pulse_widths(self._controls, self._motors))

    def _number(self, answer: ActuatorControls) -> int:
        return (answer.time_us * self._rate_hz + 500_000) // 1_000_000
