"""A node's own radio as its agent sees it: what waits in its queue, and what became of its unicasts."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

from bridge.bus.messages import DecodeError, RadioStatus

LEFT_OUT_MAX = 1000
"""Packets from outside that are remembered until it is known what became of them; queues are shorter."""


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
        self._left_out: deque[int] = deque(maxlen=LEFT_OUT_MAX)

    def on_reply(self, callback: Callable[[UnicastReply], object]) -> None:
        """Call ``callback(reply)`` for each unicast that was acknowledged or given up."""
        self._on_reply.append(callback)

    def leave_out(self, seq: int) -> None:
        """What becomes of the packet with this number is not told: it came from outside."""
        self._left_out.append(seq)

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
