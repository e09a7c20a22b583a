"""The end of an agent's tick, from its thread to the event loop's, which waits for it a little."""

from __future__ import annotations

import asyncio
import queue
from collections.abc import Callable

PATIENCE_S = 0.05
"""How long the event loop does nothing else than wait: clients and signals have to wait with it."""


class IdleAgents:
    """What agents' threads have for the event loop.

    A thread that is waited for is handed over to within microseconds; through the event loop's own selector it would be
    tens of them per agent and tick.
    """

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._idle: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        self._is_waited_for = False

    def put(self, callback: Callable[[], object]) -> None:
        """Have ``callback`` called in the event loop's thread; from any thread."""
        self._idle.put(callback)
        if not self._is_waited_for:
            self._loop.call_soon_threadsafe(self._call_all)

    def wait(self, is_over: Callable[[], bool]) -> None:
        """Call what comes until ``is_over``, or nothing has come for a while: then the event loop goes on as ever."""
        self._is_waited_for = True
        try:
            while not is_over():
                self._idle.get(timeout=PATIENCE_S)()
        except queue.Empty:
            return
        finally:
            self._is_waited_for = False
            self._loop.call_soon(self._call_all)  # what came between the last look and here

    def _call_all(self) -> None:
        while not self._idle.empty():
            self._idle.get()()
