"""The end of agents' ticks, from their threads to the event loop's, which waits for all of them a little."""

from __future__ import annotations

import asyncio
import queue
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from math import inf

PATIENCE_S = 0.05
"""How long the event loop does nothing else than wait: clients and signals have to wait with it."""


class IdleAgents:
    """What agents' threads have for the event loop.

    A thread that is waited for is handed over to within microseconds; through the event loop's own selector it would be
    tens of them per agent and tick. The last agent hands over for all.
    """

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._idle: deque[Callable[[], object]] = deque()
        self._awaited: float = 0
        """As many wake the event loop; 0: it does not wait."""
        self._wakes: queue.SimpleQueue[None] = queue.SimpleQueue()

    def put(self, callback: Callable[[], object]) -> None:
        """Have ``callback`` called in the event loop's thread; from any thread."""
        self._idle.append(callback)
        awaited = self._awaited
        if not awaited:
            self._loop.call_soon_threadsafe(self._call_all)
        elif len(self._idle) >= awaited:
            self._wakes.put(None)

    def wait(self, begin: Callable[[], object], live: Callable[[], int]) -> None:
        """Do what agents begin with, wait until all are idle, and call what they have put.

        If that takes longer than a while, the event loop goes on as ever.

        Args:
            begin: gives agents their work.
            live: how many agents are at work then.
        """
        self._awaited = inf
        try:
            begin()
            self._awaited = live()
            with suppress(queue.Empty):
                while len(self._idle) < self._awaited:
                    self._wakes.get(timeout=PATIENCE_S)
        finally:
            self._awaited = 0
            self._call_all()

    def _call_all(self) -> None:
        while self._idle:
            self._idle.popleft()()
