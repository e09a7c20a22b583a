"""Items reach the loop in order, whatever their handler does, and never more than the limit wait."""

from __future__ import annotations

import asyncio
import threading

from bridge.bus.inbox import Inbox


async def drained() -> None:
    """Let the loop run what was scheduled."""
    await asyncio.sleep(0)
    await asyncio.sleep(0)


async def test_items_from_another_thread_come_in_order() -> None:
    seen: list[int] = []
    done = asyncio.Event()

    def handle(item: int) -> None:
        seen.append(item)
        if item == 999:
            done.set()

    inbox = Inbox(asyncio.get_running_loop(), handle)
    thread = threading.Thread(target=lambda: [inbox.push(i) for i in range(1000)])
    thread.start()
    await asyncio.wait_for(done.wait(), 10)
    thread.join()
    assert seen == list(range(1000))


async def test_handler_that_raises_does_not_hold_up_what_comes_after() -> None:
    seen: list[int] = []

    def handle(item: int) -> None:
        if item == 0:
            raise RuntimeError("mine")
        seen.append(item)

    inbox = Inbox(asyncio.get_running_loop(), handle)
    for item in (0, 1):
        inbox.push(item)
    await drained()
    assert seen == [1]


async def test_oldest_is_dropped_beyond_the_limit_and_counted() -> None:
    seen: list[int] = []
    inbox = Inbox(asyncio.get_running_loop(), seen.append, limit=3)
    for item in range(5):
        inbox.push(item)
    await drained()
    assert seen == [2, 3, 4]
    assert inbox.dropped == 2


def test_push_after_the_loop_is_closed_is_quiet() -> None:
    loop = asyncio.new_event_loop()
    inbox: Inbox[int] = Inbox(loop, lambda _: None)
    loop.close()
    inbox.push(1)
    assert inbox.dropped == 0
