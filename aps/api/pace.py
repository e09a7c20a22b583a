"""How many requests an API takes: who floods it waits, and the UA and its neighbours do not notice (ASGI)."""

from __future__ import annotations

import asyncio
from collections.abc import MutableMapping
from typing import Any, Final

from aps.api.guard import App, Receive, Scope, Send
from aps.links.allowance import Allowance

__all__ = ["Paced"]

REQUESTS_PER_S: Final = 100.0
"""Of all clients together. It shares the event loop with the UA, in a run with the whole fleet: a request takes it 0.5
to 2 ms. Whoever wants to know more often has the stream."""
BYTES_PER_REQUEST: Final = 4096
"""To read so much of a body costs as much as a request."""


class Paced:
    """Lets requests wait that come faster than that for good.

    Args:
        app: what answers them.
        requests_per_s: how many; half a second's worth may come at once.
    """

    def __init__(self, app: App, requests_per_s: float = REQUESTS_PER_S) -> None:
        self._app = app
        self._allowance = Allowance(requests_per_s)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""

        async def paced() -> MutableMapping[str, Any]:
            message = await receive()
            await self._wait(len(message.get("body", b"")) / BYTES_PER_REQUEST)
            return message

        if scope["type"] in ("http", "websocket"):
            await self._wait(1.0)
        await self._app(scope, paced if scope["type"] == "http" else receive, send)

    async def _wait(self, requests: float) -> None:
        wait_s = self._allowance.charge(requests, 0, asyncio.get_running_loop().time()) if requests else 0.0
        if wait_s > 0.0:
            await asyncio.sleep(wait_s)
