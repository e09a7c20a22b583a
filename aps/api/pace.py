"""How many requests an API takes: a flood waits or is told to come again, and does not slow down the UA (ASGI)."""

from __future__ import annotations

import asyncio
from collections.abc import MutableMapping
from typing import Any, Final

from aps.api.guard import App, Receive, Scope, Send, refuse
from aps.links.allowance import Allowance

REQUESTS_PER_S: Final = 100.0
"""Of all clients together. It shares the event loop with the UA, in a run with the whole fleet: a request takes it 0.5
to 2 ms. Whoever wants to know more often has the stream."""
BYTES_PER_REQUEST: Final = 4096
"""To read so much of a body costs as much as a request; of each request so much is free."""
SLICE_REQUESTS: Final = 10.0
"""So much of a body is charged at a time, so that others come in between."""
AGAIN_S: Final = 0.001
"""A body that finds no room tries again so long after there should be some."""
LOOK_WAIT_S: Final = 0.25
"""What only looks, and bodies, find room up to this wait ..."""
MOST_WAIT_S: Final = 0.5
"""... and what changes something up to this one: a flood of looks keeps no command out."""
RETRY_AFTER_S: Final = 1
"""Whole seconds (RFC 9110, 10.2.3)."""
LOOKS: Final = ("GET", "HEAD", "OPTIONS")


class PacedApi:
    """Lets requests wait that come faster than that for good, and refuses those that would wait for long (429).

    A request whose client hangs up before its turn gives its share back.

    Args:
        app: what answers them.
        requests_per_s: how many; half a second's worth may come at once.
    """

    def __init__(self, app: App, requests_per_s: float = REQUESTS_PER_S) -> None:
        self._app = app
        self._allowance = Allowance(requests_per_s)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        if self._charge(0.0) >= (LOOK_WAIT_S if scope.get("method", "GET") in LOOKS else MOST_WAIT_S):
            headers = [(b"retry-after", str(RETRY_AFTER_S).encode())]
            await refuse(scope, receive, send, 429, "too many requests", headers)
            return
        early: list[MutableMapping[str, Any]] = []
        if await _hangs_up(receive, self._charge(1.0), early):
            self._charge(-1.0)
            return
        await self._app(scope, self._paced(receive, early), send)

    def _charge(self, requests: float) -> float:
        """How long it then is until the next one's turn, s."""
        return self._allowance.charge(requests, 0, asyncio.get_running_loop().time())

    def _paced(self, receive: Receive, early: list[MutableMapping[str, Any]]) -> Receive:
        """What was received early, then the rest; long bodies no faster than requests."""
        free = 1.0

        async def paced() -> MutableMapping[str, Any]:
            nonlocal free
            message = early.pop(0) if early else await receive()
            requests = len(message.get("body", b"")) / BYTES_PER_REQUEST
            due, free = max(0.0, requests - free), max(0.0, free - requests)
            while due > 0.0:
                too_early_s = self._charge(0.0) - LOOK_WAIT_S
                if too_early_s > 0.0:
                    await asyncio.sleep(too_early_s + AGAIN_S)
                    continue
                await asyncio.sleep(self._charge(min(due, SLICE_REQUESTS)))
                due -= SLICE_REQUESTS
            return message

        return paced


async def _hangs_up(receive: Receive, wait_s: float, early: list[MutableMapping[str, Any]]) -> bool:
    """Whether the client does within that time; what it says meanwhile is added to `early`."""
    if wait_s <= 0.0:
        return False
    try:
        async with asyncio.timeout(wait_s):
            while not (early and early[-1].get("more_body")):
                early.append(await receive())
                if early[-1]["type"] in ("http.disconnect", "websocket.disconnect"):
                    return True
            await asyncio.sleep(wait_s)
    except TimeoutError:
        pass
    return False
