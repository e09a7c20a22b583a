"""Which frame a servo packet asks for. Sans-IO: packets, senders and wall instants in, a verdict out.

SITL sends its servos with a frame_count, blocks until a reply comes, and counts up. It never drains its
socket, so a frame_count answered twice leaves it one frame behind for good: each is answered once. It repeats
the packet about every 1.1 s while it has no reply; only then is the reply lost, and the cached
one sent again.

    frame_count            same sender                                another sender
    last + 1               ADVANCE                                    ADVANCE
    beyond (modulo 2**32)  GAP: answered, counted                     GAP
    last, not answered     WAITING                                    RESTART
    last, answered         DUPLICATE; RESEND after 1 s of silence     RESTART
    a little below         STALE: reordered on the way                RESTART
    far below              RESTART: the autopilot has booted anew     RESTART
    0, if not last + 1     RESTART; STALE after 1                     RESTART

Two autopilots on one port would take the UA from each other with every packet. So those whose place another has
taken are not heard any more, however long that one is silent, before they boot anew: SITL, started beside another,
begins at 0, and the later one flies, also when it is started once more.
"""

from __future__ import annotations

from enum import Enum, unique
from typing import Any

from fdm.wire.servo_packet import FRAME_COUNT_MODULUS

RESEND_SILENCE_NS = 1_000_000_000
"""Wall time after a reply from which a repeated packet means that the reply was lost."""
REPLACED_KEPT = 8
"""So many of these are known: each boot of an autopilot is one more, at another port."""
REORDER_SPAN = 16
"""A frame_count this little below the last one, from the same sender, is a late datagram, not a boot."""
_HALF = FRAME_COUNT_MODULUS // 2


@unique
class ServoVerdict(Enum):
    """What to do with a servo packet. The value is also the name of its counter."""

    BOOT = "boots"
    """First packet ever: start the UA's time, step, answer."""
    RESTART = "restarts"
    """The autopilot booted anew: reset the UA, start its time, step, answer."""
    ADVANCE = "frames"
    """Next frame: step, answer."""
    GAP = "gaps"
    """A later frame than the next: step once, answer."""
    WAITING = "repeats_while_waiting"
    """Repeat of a frame that is not answered yet: nothing to do."""
    DUPLICATE = "duplicates"
    """Repeat of an answered frame, too soon to mean a lost reply: nothing to do."""
    RESEND = "replies_sent_again"
    """Repeat of an answered frame after silence: send the cached reply."""
    STALE = "stale"
    """A late datagram: nothing to do."""
    REPLACED = "from_the_one_replaced"
    """Of an autopilot whose place another one has taken: nothing to do."""


STEPPING = frozenset({ServoVerdict.BOOT, ServoVerdict.RESTART, ServoVerdict.ADVANCE, ServoVerdict.GAP})
"""The verdicts after which the UA owes a step and a reply."""


class Lockstep:
    """The lockstep of one UA.

    Attributes:
        sender: source address of the latest packet that was heard and not stale; replies go there. None before the
            first.
        replaced: the senders before that one, the latest first, with the last frame_count that was heard of each.
        reply: the latest reply, as encoded, for RESEND; empty before the first.
        unread: answers that the autopilot has not shown to have read; each new packet shows that it read one. With
            none left it is blocked, and all that it had to say before its latest packet is said.
    """

    __slots__ = ("_answered", "_answered_at_ns", "_frame_count", "replaced", "reply", "sender", "unread")

    def __init__(self) -> None:
        self._frame_count = -1
        self._answered = -1
        self._answered_at_ns = 0
        self.sender: Any = None
        self.replaced: dict[Any, int] = {}
        self.reply: Any = b""
        self.unread = 0

    @property
    def waiting(self) -> bool:
        """The latest frame asked for is not answered yet."""
        return self._answered != self._frame_count

    def receive(self, frame_count: int, sender: object, wall_ns: int) -> ServoVerdict:
        """Judge a packet, and take note of it.

        Args:
            frame_count: of the packet, 0 to 2**32 - 1.
            sender: its source address; compared with ``==``.
            wall_ns: monotonic wall time, ns.
        """
        if sender == self.sender and (frame_count - self._frame_count) % FRAME_COUNT_MODULUS == 1:
            self._frame_count = frame_count
            if self.unread:
                self.unread -= 1
            return ServoVerdict.ADVANCE
        return self._judge_unusual(frame_count, sender, wall_ns)

    def answered(self, frame_count: int, reply: Any, wall_ns: int) -> None:
        """Take note that `frame_count` was answered with `reply` at `wall_ns`."""
        self._answered = frame_count
        self.reply = reply
        self._answered_at_ns = wall_ns
        self.unread += 1

    def answered_beforehand(self, wall_ns: int) -> None:
        """Take note of an answer, at `wall_ns`, that no packet has asked for yet."""
        self._answered_at_ns = wall_ns
        self.unread += 1

    def _judge_unusual(self, frame_count: int, sender: object, wall_ns: int) -> ServoVerdict:
        if self._frame_count < 0:
            return self._take(frame_count, sender, wall_ns, ServoVerdict.BOOT)
        if sender in self.replaced and (frame_count or self.replaced[sender] <= REORDER_SPAN):
            return ServoVerdict.REPLACED
        ahead = (frame_count - self._frame_count) % FRAME_COUNT_MODULUS
        if 0 < ahead < _HALF and (frame_count or ahead == 1):
            unread = max(0, self.unread - ahead)
            verdict = self._take(
                frame_count, sender, wall_ns, ServoVerdict.ADVANCE if ahead == 1 else ServoVerdict.GAP
            )
            self.unread = unread
            return verdict
        if sender != self.sender:
            return self._take(frame_count, sender, wall_ns, ServoVerdict.RESTART)
        if ahead == 0:
            return self._judge_repeat(wall_ns)
        if FRAME_COUNT_MODULUS - ahead <= REORDER_SPAN and (frame_count or self._frame_count == 1):
            return ServoVerdict.STALE
        return self._take(frame_count, sender, wall_ns, ServoVerdict.RESTART)

    def _judge_repeat(self, wall_ns: int) -> ServoVerdict:
        if self.waiting:
            if wall_ns - self._answered_at_ns >= RESEND_SILENCE_NS:
                self.unread = 0  # it has none, or it would have gone on: one was lost
            return ServoVerdict.WAITING
        if wall_ns - self._answered_at_ns < RESEND_SILENCE_NS:
            return ServoVerdict.DUPLICATE
        self._answered_at_ns = wall_ns
        return ServoVerdict.RESEND

    def _take(self, frame_count: int, sender: object, wall_ns: int, verdict: ServoVerdict) -> ServoVerdict:
        if sender != self.sender:
            others = [(self.sender, self._frame_count), *self.replaced.items()]
            kept = [each for each in others if each[0] not in (None, sender)][:REPLACED_KEPT]
            self.replaced, self.sender, self._answered_at_ns = dict(kept), sender, wall_ns
        self._frame_count = frame_count
        self._answered = -1
        self.unread = 0
        return verdict


class FrameTimer:
    """Time of one UA since its autopilot's boot, counted in frames: exact after any number of them.

    While the rate stays, the time after n frames is ``n * 10**9 // rate`` ns after the instant from which it
    holds.

    Attributes:
        time_ns: the present time, ns.
        rate_hz: rate of the latest frame, Hz; 0 before the first.
    """

    __slots__ = ("_base_ns", "_frames", "rate_hz", "time_ns")

    def __init__(self) -> None:
        self._base_ns = 0
        self._frames = 0
        self.rate_hz = 0
        self.time_ns = 0

    def next_ns(self, rate_hz: int) -> int:
        """The time after one more frame at `rate_hz`, without taking it."""
        if rate_hz == self.rate_hz:
            return self._base_ns + (self._frames + 1) * 1_000_000_000 // rate_hz
        return self.time_ns + 1_000_000_000 // rate_hz

    def advance(self, rate_hz: int) -> int:
        """Take one frame at `rate_hz`; returns the new time, ns."""
        if rate_hz != self.rate_hz:
            self._base_ns, self._frames, self.rate_hz = self.time_ns, 0, rate_hz
        self._frames += 1
        self.time_ns = self._base_ns + self._frames * 1_000_000_000 // rate_hz
        return self.time_ns
