"""From Zenoh's threads into an asyncio loop: bounded, in order, one wake-up for many items."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")
log = logging.getLogger("inbox")


class Inbox(Generic[T]):
    """Hands items from any thread to ``handle`` in the loop's thread.

    A handler that raises is logged and counted in ``failed``; the items behind it are handled all the same. When more
    than ``limit`` items wait, the oldest is dropped and ``dropped`` counts it; ``limit`` None: nothing is ever dropped.
    """

    def __init__(
        self, loop: asyncio.AbstractEventLoop, handle: Callable[[T], object], limit: int | None = 100_000
    ) -> None:
        self._loop = loop
        self._handle = handle
        self._limit = limit
        self._items: deque[T] = deque()
        self._awake = False
        self.dropped = 0
        self.failed = 0

    def push(self, item: T) -> None:
        """Add an item; safe from any thread, and after the loop has been closed."""
        if self._limit is not None and len(self._items) >= self._limit:
            self._items.popleft()
            self.dropped += 1
        self._items.append(item)
        if not self._awake:
            self._awake = True
            try:
                self._loop.call_soon_threadsafe(self._drain)
            except RuntimeError:  # the loop is closed: nobody is there to hand it to
                self._items.clear()

    def _drain(self) -> None:
        self._awake = False
        while self._items:
            try:
                self._handle(self._items.popleft())
            except Exception:
                self.failed += 1
                log.exception("while handling an item")
