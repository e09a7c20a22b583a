"""A node's own radio as its agent sees it: what waits in its queue, and what became of its unicasts."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

from bridge.bus.messages import DecodeError, RadioStatus

RUNS_MAX = 100_000
"""So many runs of packets from outside, without one of the agent's between them, are remembered: more than wait."""


class QueueState(NamedTuple):
    """What waits in a transmit queue.

    Attributes:
        packets: how many.
        length_bytes: of all together.
    """

    packets: int = 0
    length_bytes: int = 0


class UnicastReply(NamedTuple):
    """What a node learns of its unicast.

    Attributes:
        seq: of the packet, as `UaClient.transmit` returned it.
        acknowledged: whether its addressee has it; False: it was given up.
        attempts: how often it was on the air.
        at_ns: when that was known, sim time.
    """

    seq: int
    acknowledged: bool
    attempts: int
    at_ns: int


class NumberRuns:
    """A set of rising numbers, as runs of consecutive ones; of many runs the oldest are forgotten."""

    def __init__(self) -> None:
        self._firsts: list[int] = []
        self._lasts: list[int] = []

    def add(self, number: int) -> None:
        """Take the next, which is above all others."""
        if self._lasts and self._lasts[-1] == number - 1:
            self._lasts[-1] = number
            return
        if len(self._firsts) >= 2 * RUNS_MAX:
            del self._firsts[:RUNS_MAX], self._lasts[:RUNS_MAX]
        self._firsts.append(number)
        self._lasts.append(number)

    def __contains__(self, number: int) -> bool:
        place = bisect_right(self._firsts, number) - 1
        return place >= 0 and number <= self._lasts[place]


class OwnRadio:
    """Of one node. On a medium that takes no time nothing waits, and nothing is acknowledged.

    Attributes:
        queue: what waited just before this tick.
        replies: what became known of unicasts since the last tick.
    """

    def __init__(self) -> None:
        self.queue = QueueState()
        self.replies: tuple[UnicastReply, ...] = ()
        self._on_reply: list[Callable[[UnicastReply], object]] = []
        self._left_out = NumberRuns()

    def on_reply(self, callback: Callable[[UnicastReply], object]) -> None:
        """Call ``callback(reply)`` for each unicast that was acknowledged or given up."""
        self._on_reply.append(callback)

    def leave_out(self, seq: int) -> None:
        """What becomes of the packet with this number is not told: it came from outside."""
        self._left_out.add(seq)

    def begin(self) -> None:
        """A tick begins: what was said before it is old."""
        self.replies = ()

    def take(self, queue: QueueState | None, replies: Sequence[UnicastReply]) -> None:
        """What the radio says; raises what the callbacks raise."""
        self.queue = self.queue if queue is None else queue
        self.replies = tuple(reply for reply in replies if reply.seq not in self._left_out)
        for reply in self.replies:
            for callback in self._on_reply:
                callback(reply)


def queues_in(message: RadioStatus) -> Iterator[tuple[QueueState, str]]:
    """The transmit queues of a message, each with the name of its radio.

    Raises:
        DecodeError: its columns are of several lengths.
    """
    for radio, *queue in _rows(message.queue_radio, message.queue_packets, message.queue_bytes):
        yield QueueState(*queue), radio


def replies_in(message: RadioStatus) -> Iterator[tuple[UnicastReply, str]]:
    """What became of unicasts by a message, each with the name of its radio.

    Raises:
        DecodeError: its columns are of several lengths.
    """
    m = message
    columns = m.reply_seq, m.reply_acknowledged, m.reply_attempts, m.reply_ns
    for radio, *reply in _rows(m.reply_radio, *columns):
        yield UnicastReply(*reply), radio


def _rows(*columns: Iterable[Any]) -> list[tuple[Any, ...]]:
    try:
        return list(zip(*columns, strict=True))
    except ValueError as error:
        raise DecodeError(f"RadioStatus: {error}") from error
