"""Work in threads of its own.

Those of asyncio (`asyncio.to_thread`) take nothing more once the main thread has come to its end, while a flight in
another thread goes on.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

T = TypeVar("T")


def begun(work: Callable[[], T], name: str) -> Future[T]:
    """Begin it in a thread of this name; gives what will come of it."""
    outcome: Future[T] = Future()
    outcome.set_running_or_notify_cancel()  # nobody can stop it

    def do() -> None:
        try:
            outcome.set_result(work())
        except BaseException as error:
            outcome.set_exception(error)

    threading.Thread(target=do, name=name).start()
    return outcome


async def in_own_thread(work: Callable[[], T]) -> T:
    """Do it in a thread, and wait for it."""
    return await asyncio.wrap_future(begun(work, "beside the flight"))
