"""Who floods an API waits: nothing is refused, and what is due in between gets its turn."""

from __future__ import annotations

import asyncio
import selectors
from typing import Any

from aps.api.pace import Paced


class Waits(selectors.DefaultSelector):
    """Does not wait: the clock is then what would have been waited for."""

    now_s = 0.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        assert timeout is not None, "nothing is due any more"
        self.now_s += max(0.0, timeout)
        return super().select(0)


class Clocked(asyncio.SelectorEventLoop):
    """An event loop by such a clock."""

    def __init__(self) -> None:
        self.waits = Waits()
        super().__init__(self.waits)

    def time(self) -> float:
        return self.waits.now_s


def instants(count: int, body: bytes = b"") -> list[float]:
    """When each of so many requests that come at once reaches the app, s."""
    loop = Clocked()
    reached: list[float] = []

    async def app(_scope: Any, receive: Any, _send: Any) -> None:
        await receive()
        reached.append(loop.time())

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": body}

    async def come() -> None:
        paced = Paced(app, 100.0)
        await asyncio.gather(*(paced({"type": "http"}, receive, None) for _ in range(count)))  # type: ignore[arg-type]

    try:
        loop.run_until_complete(come())
    finally:
        loop.close()
    return sorted(reached)


def test_half_a_seconds_worth_comes_at_once_and_the_rest_in_turn() -> None:
    reached = instants(250)
    assert sum(instant == 0.0 for instant in reached) in (50, 51)
    assert 1.9 <= reached[-1] <= 2.1


def test_a_long_body_counts_as_many_requests() -> None:
    assert 0.9 <= instants(1, b"x" * (150 * 4096))[0] <= 1.1
