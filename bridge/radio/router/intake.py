"""What waits for the radio's one thread: in the order in which it came, and bounded by number and by bytes."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Any, NamedTuple

from bridge.bus.session import Query, Sample, Stamp

WAITING_MAX = 200_000
WAITING_MAX_BYTES = 256 << 20
"""Samples of senders that may wait; more are dropped and counted, as a host that cannot keep up drops them."""
Handler = Callable[[str, Any], None]
"""Takes a key, and the sample or query that came on it."""


class Waiting(NamedTuple):
    """A sample or a query, and who handles it.

    Attributes:
        lost: highest number that was dropped before it, by key.
    """

    handler: Handler
    came: Sample | Query
    lost: dict[str, int]


class Intake:
    """A queue from Zenoh's threads to the radio's.

    Args:
        wake: called, in any thread, when something has come.

    Attributes:
        dropped: samples that found no room.
    """

    def __init__(self, wake: Callable[[], object] = lambda: None) -> None:
        self.dropped = 0
        self._wake = wake
        self._queue: queue.SimpleQueue[Waiting | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._bytes = 0
        self._lost: dict[str, int] = {}

    def push(self, handler: Handler, came: Sample | Query, *, may_drop: bool) -> None:
        """Keep what came; called in Zenoh's threads. A sender's sample may be dropped, one of the ring never."""
        length = len(came.payload or b"")
        with self._lock:
            full = self._queue.qsize() >= WAITING_MAX or self._bytes + length > WAITING_MAX_BYTES
            if may_drop and full:
                self.dropped += 1
                stamp = Stamp.from_sample(came)
                if stamp is not None:
                    self._lost[str(came.key_expr)] = stamp.seq
                return
            self._bytes += length
            lost, self._lost = self._lost, {}
            self._queue.put(Waiting(handler, came, lost))
        self._wake()

    def end(self) -> None:
        """Let `get` return None; callable from a signal handler."""
        self._queue.put(None)

    def get(self, timeout_s: float) -> Waiting | None:
        """What came next; None when it is over.

        Raises:
            queue.Empty: nothing came in time.
        """
        item = self._queue.get(timeout=timeout_s)
        if item is not None:
            with self._lock:
                self._bytes -= len(item.came.payload or b"")
        return item
