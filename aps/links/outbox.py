"""Bounded queues in front of connections: a peer that does not read costs drops, never memory or time."""

from __future__ import annotations

import asyncio
import socket
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

DEFAULT_LIMIT_BYTES: Final = 256 * 1024
"""About 5000 messages, or 20 s of a busy link."""
LEAST_QUEUE_BYTES: Final = 1024
KERNEL_BUFFER_BYTES: Final = 32 * 1024
"""Asked of the kernel, which grants twice as much. It would buffer megabytes for a peer that does not read: minutes of
stale telemetry."""
WRITE_BYTES: Final = 4 * 1024
"""Handed to the transport at once; what the kernel does not take of it cannot give way any more."""
_NOTSENT_LOWAT: Final[int | None] = getattr(socket, "TCP_NOTSENT_LOWAT", None)
"""Linux and macOS: the kernel takes nothing more while so much has not been sent yet."""
STALL_S: Final = 1.0
"""A peer that has not read for so long has stalled ..."""
STALLED_LIMIT_BYTES: Final = 8 * 1024
"""... and only so much of the newest is kept for it: when it reads again, it wants to know how things are."""


@dataclass(slots=True)
class OutboxCounters:
    """What was queued, and what became of it. ``queued = written + dropped + still waiting``."""

    queued_frames: int = 0
    written_frames: int = 0
    written_bytes: int = 0
    dropped_full: int = 0
    """Oldest frames dropped because the peer did not read."""
    dropped_closed: int = 0
    """Frames for a peer that is not there, or that went away with frames waiting."""
    stalls: int = 0
    """How often the peer stopped reading for so long that only the newest was kept for it."""


class FrameQueue:
    """A bounded queue of whole frames: the oldest go first when the limit is reached."""

    def __init__(self, limit_bytes: int = DEFAULT_LIMIT_BYTES) -> None:
        if limit_bytes < LEAST_QUEUE_BYTES:
            raise ValueError(f"an outbox needs at least {LEAST_QUEUE_BYTES} bytes, not {limit_bytes}")
        self.limit_bytes = limit_bytes
        self.counters = OutboxCounters()
        self._open = False
        self.waiting: deque[bytes] = deque()
        """Frames not yet handed on: to be looked at only."""
        self._waiting_bytes = 0

    def admit(self) -> None:
        """There is a connection: take frames from now on."""
        self._open = True

    def close(self) -> None:
        """The connection is gone: what waits is counted as dropped."""
        self._open = False
        self.counters.dropped_closed += len(self.waiting)
        self.waiting.clear()
        self._waiting_bytes = 0

    def put(self, frame: bytes) -> None:
        """Queue one frame."""
        self.counters.queued_frames += 1
        if not self._open:
            self.counters.dropped_closed += 1
            return
        self.waiting.append(frame)
        self._waiting_bytes += len(frame)
        if self._waiting_bytes > self.limit_bytes:
            self._drop_oldest(self.limit_bytes)

    def put_all(self, frames: list[bytes], size_bytes: int) -> None:
        """Queue several frames; ``size_bytes`` is the length of all."""
        self.counters.queued_frames += len(frames)
        if not self._open:
            self.counters.dropped_closed += len(frames)
            return
        self.waiting.extend(frames)
        self._waiting_bytes += size_bytes
        if self._waiting_bytes > self.limit_bytes:
            self._drop_oldest(self.limit_bytes)

    def _drop_oldest(self, limit_bytes: int) -> None:
        while self._waiting_bytes > limit_bytes:
            self._waiting_bytes -= len(self.waiting.popleft())
            self.counters.dropped_full += 1

    def flush(self) -> None:
        """Write what waits, if the queue has a way to do so by itself."""

    def take(self, limit_bytes: int) -> bytes:
        """The oldest frames, whole, as many as fit into ``limit_bytes``."""
        waiting, counters = self.waiting, self.counters
        if self._waiting_bytes <= limit_bytes:  # the common case
            counters.written_frames += len(waiting)
            counters.written_bytes += self._waiting_bytes
            data = waiting[0] if len(waiting) == 1 else b"".join(waiting)
            waiting.clear()
            self._waiting_bytes = 0
            return data
        frames, room = [], limit_bytes
        while waiting and len(waiting[0]) <= room:
            frames.append(waiting.popleft())
            room -= len(frames[-1])
        data = b"".join(frames)
        self._waiting_bytes -= len(data)
        counters.written_frames += len(frames)
        counters.written_bytes += len(data)
        return data


class Outbox(FrameQueue):
    """Frames wait here while an asyncio transport is full.

    Frames put between two calls of ``flush`` leave in one write.
    """

    def __init__(
        self, limit_bytes: int = DEFAULT_LIMIT_BYTES, clock_s: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__(limit_bytes)
        self._clock_s = clock_s
        self._transport: asyncio.Transport | None = None
        self._paused = False
        self._paused_s = 0.0
        self._stalled = False

    @property
    def paused(self) -> bool:
        """Whether the transport is full (the peer does not read fast enough)."""
        return self._paused

    def open(self, transport: asyncio.Transport) -> None:
        """The connection is there."""
        transport.set_write_buffer_limits(
            high=0
        )  # what the kernel does not take waits here, where the oldest give way
        connection = transport.get_extra_info("socket")
        if connection is not None:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, KERNEL_BUFFER_BYTES)
            if connection.family in (socket.AF_INET, socket.AF_INET6) and _NOTSENT_LOWAT is not None:
                connection.setsockopt(socket.IPPROTO_TCP, _NOTSENT_LOWAT, WRITE_BYTES)
        self._transport, self._paused, self._stalled = transport, False, False
        self.admit()

    def close(self) -> None:
        """The connection is gone: what waits is counted as dropped."""
        self._transport = None
        super().close()

    def flush(self) -> None:
        """Hand everything to the transport, unless it is full."""
        if self._paused:
            if self._waiting_bytes > STALLED_LIMIT_BYTES:
                self._check_stall()
            return
        while self.waiting and not self._paused and self._transport is not None:
            self._transport.write(self.take(WRITE_BYTES))

    def _check_stall(self) -> None:
        if not self._stalled and self._clock_s() - self._paused_s >= STALL_S:
            self._stalled = True
            self.counters.stalls += 1
        if self._stalled:
            self._drop_oldest(STALLED_LIMIT_BYTES)

    def pause(self) -> None:
        """The transport's buffer is full."""
        self._paused, self._paused_s = True, self._clock_s()

    def resume(self) -> None:
        """The transport's buffer has room again."""
        self._paused = self._stalled = False
        self.flush()
