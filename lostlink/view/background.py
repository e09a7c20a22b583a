"""The tasks that a view lives by: the death of one ends the view, with a word; no picture stands still unseen."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any


class ViewDied(RuntimeError):
    """A part of the view is no more; the text says which, and of what it died."""


class Background:
    """Tasks that go on until `end`, and whoever waits for their death meanwhile."""

    def __init__(self) -> None:
        self._tasks: set[asyncio.Task[None]] = set()
        self._death: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    def start(self, work: Coroutine[Any, Any, None], what: str) -> None:
        """Have ``work`` go on; ``what`` is what people call it."""
        task = asyncio.create_task(work, name=what)
        self._tasks.add(task)
        task.add_done_callback(self._ended)

    def die(self, what: str, error: BaseException | None) -> None:
        """Something that the view lives by has ended."""
        if not self._death.done():
            self._death.set_exception(
                ViewDied(f"the view ends: {what} ended: {type(error).__name__}: {error}")
            )

    def _ended(self, task: asyncio.Task[None]) -> None:
        if not task.cancelled():
            self.die(task.get_name(), task.exception())

    async def until(self, *events: asyncio.Event) -> None:
        """Wait for one of these events.

        Raises:
            ViewDied: a task ended before.
        """
        waiting: set[asyncio.Future[Any]] = {asyncio.create_task(event.wait()) for event in events}
        try:
            await asyncio.wait({*waiting, self._death}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for each in waiting:
                each.cancel()
        if self._death.done():
            self._death.result()

    async def end(self) -> None:
        """Cancel all."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._death.cancel()
