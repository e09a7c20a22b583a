"""When a frame that was sent to PX4 is done. Sans-IO: bytes, instants and whether PX4 is at rest come in.

A frame is done when PX4 is at rest: what the frame has set going is over, all that PX4 says is said, and if it has not
answered by then it will not, and keeps its outputs (so it is while it boots). What a frame comes to is thus a matter of
the frames before it alone, and of no wall time. One that is answered has said all that the model needs: it may be taken
as done before, if PX4 is at rest when the next one is sent.

Where nobody can see whether PX4 is at rest (it is on another machine), a frame is done when it is answered; before the
first answer also when patience has run out.
"""

from __future__ import annotations

from collections import Counter

from fdm.wire.px4.hil import CONTROLS, FROM_PX4, ActuatorControls, pulse_widths, read_actuators
from fdm.wire.px4.mavlink import FrameReader
from fdm.wire.servo_packet import Fields

PATIENCE_NS = 20_000_000
"""Wall time after which a frame is done that nobody answers, where rest cannot be seen and none was answered yet."""
SILENCE_S = 4
"""Sim time without an answer that is told; while it boots, PX4 is silent for less than half a second of it."""
_IDLE = (0.0,) * CONTROLS


class FramesOfPx4:
    """The frames of one connection.

    Args:
        rate_hz: frames per second.
        motors: outputs that are motors.
        sees_rest: whether it can be seen if PX4 is at rest.

    Attributes:
        counters: what was dropped, and frames without an answer.
        has_answered: whether any frame was answered.
        is_lockstep: whether PX4's clock is ours, as far as it has said; else it cannot be flown.
    """

    def __init__(self, rate_hz: int, motors: frozenset[int], *, sees_rest: bool = True) -> None:
        self._rate_hz, self._motors, self._sees_rest = rate_hz, motors, sees_rest
        self._reader = FrameReader(FROM_PX4)
        self._awaited = -1
        self._sent_ns = 0
        self._answer: ActuatorControls | None = None
        self._controls: tuple[float, ...] = _IDLE
        self._silent_frames = 0
        self.has_answered, self.is_lockstep = False, True
        self.counters: Counter[str] = Counter()

    @property
    def awaits(self) -> bool:
        """Whether a frame is under way."""
        return self._awaited >= 0

    @property
    def answered(self) -> bool:
        """Whether the frame that is under way is answered."""
        return self._answer is not None

    @property
    def falls_silent(self) -> bool:
        """Whether the frame that was done last is the one with which PX4 has said nothing for SILENCE_S."""
        return self._silent_frames == SILENCE_S * self._rate_hz

    def hello(self) -> Fields:
        """PX4 has connected: it wants the first frame."""
        return self._fields(0)

    def sent(self, frame: int, wall_ns: int) -> None:
        """Frame `frame`, counted from 1, was sent at `wall_ns` (monotonic)."""
        self._awaited, self._sent_ns, self._answer = frame, wall_ns, None

    def receive(self, data: bytes) -> None:
        """Take what PX4 sent. Never raises."""
        for _, payload in self._reader.feed(data):
            answer = read_actuators(payload)
            if answer is None:
                self.counters["bad_controls"] += 1
            elif not answer.is_lockstep:
                self.counters["answers_not_in_lockstep"] += 1
                self.is_lockstep = False
            elif self._number(answer) != self._awaited or self._answer is not None:
                self.counters["answers_not_asked_for"] += 1
            else:
                self._answer = answer

    def is_done(self, wall_ns: int) -> bool:
        """Where rest cannot be seen: whether the frame is done."""
        late = not self.has_answered and wall_ns - self._sent_ns >= PATIENCE_NS
        return not self._sees_rest and self.awaits and (self.answered or late)

    def done(self) -> Fields:
        """The frame is done: the packet that asks for the next one."""
        frame, self._awaited = self._awaited, -1
        if self._answer is None:
            self.counters["frames_unanswered"] += 1
            self._silent_frames += 1
        else:
            self.has_answered, self._silent_frames = True, 0
            self._controls = self._answer.controls
        return self._fields(frame)

    def totals(self) -> Counter[str]:
        """What was dropped of the stream and of its messages, and frames without an answer."""
        dropped = {name: count for name, count in self._reader.counters.items() if name != "other_messages"}
        return self.counters + Counter(dropped)

    def _fields(self, frame: int) -> Fields:
        return (0, self._rate_hz, frame, *pulse_widths(self._controls, self._motors))

    def _number(self, answer: ActuatorControls) -> int:
        return (answer.time_us * self._rate_hz + 500_000) // 1_000_000
