"""An ASGI application served in the event loop of whoever starts it, at one address, until it is stopped."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from typing import Any, Final, Self

import uvicorn
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState
from uvicorn.protocols.http.auto import AutoHTTPProtocol

BACKLOG = 64
"""Connections accepted in one turn of the event loop."""
HEAD_S = 10.0
"""Between two looks at a connection: one that has been without a whole request at both is closed."""
DIED: Final = 1011
"""WebSocket close code: an internal error."""
_log = logging.getLogger(__name__)
STOP_S = 5.0
"""Until a server that does not end of itself is ended."""


class _Server(uvicorn.Server):
    """uvicorn without its signal handlers: signals are the program's."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


class _Connection(AutoHTTPProtocol):  # type: ignore[misc, valid-type]
    """uvicorn's, which answers one too many with 503 when it asks, and keeps it, and all that never ask, for good."""

    def connection_made(self, transport: asyncio.Transport) -> None:
        """asyncio: it is there; beyond those that are answered it ends at once."""
        super().connection_made(transport)
        if len(self.connections) > self.limit_concurrency:
            transport.abort()
        else:
            self.loop.call_later(HEAD_S, self._look, None)

    def _look(self, before: object) -> None:
        """Close it if it waits for a request as it did before, after the same one."""
        if self not in self.connections:  # it has ended, or is a WebSocket
            return
        waits = self.cycle is None or self.cycle.response_complete
        if waits and self.cycle is before:
            self.transport.close()
        else:
            self.loop.call_later(HEAD_S, self._look, self.cycle if waits else self)


class Serving:
    """An async context manager: it serves from entry to exit, does not log requests, and does not name itself.

    Args:
        app: the application.
        host: address or name to listen at.
        port: TCP port; 0 for any free one.
        name: of its task.
        connections_max: how many there may be at once, less one; that one is answered 503, and further ones end.
        on_failure: called with the error if it ends before it is stopped.
        settings: further ones of `uvicorn.Config`.

    Attributes:
        port: where it listens.

    Raises:
        OSError: the port is taken (on entering the context).
    """

    def __init__(
        self,
        app: Any,
        host: str,
        port: int,
        name: str,
        connections_max: int,
        on_failure: Callable[[BaseException], object] = lambda _error: None,
        **settings: Any,
    ) -> None:
        self.port = port
        self._host, self._name = host, name
        self._on_failure = on_failure
        self._server = _Server(
            uvicorn.Config(
                app,
                http=_Connection,
                backlog=BACKLOG,
                limit_concurrency=connections_max,
                log_config=None,
                access_log=False,
                log_level="warning",
                ws="websockets-sansio",
                server_header=False,
                proxy_headers=False,
                timeout_graceful_shutdown=1,
                **settings,
            )
        )

    async def __aenter__(self) -> Self:
        family = socket.AF_INET6 if ":" in self._host else socket.AF_INET
        self._listening = socket.create_server((self._host, self.port), family=family, backlog=BACKLOG)
        # Inherited by each connection. Without it a reply's second segment waits for a delayed acknowledgement, 40 ms.
        self._listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.port = self._listening.getsockname()[1]
        self._task = asyncio.create_task(self._server.serve(sockets=[self._listening]), name=self._name)
        self._task.add_done_callback(self._ended)
        return self

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._listening.close()
        if self._server.should_exit or task.cancelled():
            return
        error = task.exception() or RuntimeError(f"the web server of the {self._name} ended of itself")
        _log.error("nothing is served at port %d any more", self.port, exc_info=error)
        self._on_failure(error)

    async def __aexit__(self, *_: object) -> None:
        self._server.should_exit = True
        await asyncio.wait({self._task}, timeout=STOP_S)
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)


async def serve_client(client: WebSocket, *works: Coroutine[Any, Any, None]) -> None:
    """Serve a client that was accepted by all of these until it goes; it is disconnected if one of them dies."""
    listening = asyncio.create_task(_until_gone(client))
    tasks = [listening, *(asyncio.create_task(work) for work in works)]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        errors = [error for task in done if task is not listening and (error := task.exception())]
        is_there = WebSocketState.CONNECTED == client.client_state == client.application_state
        if errors and is_there and not isinstance(errors[0], WebSocketDisconnect):
            _log.error("a client is served no more", exc_info=errors[0])
            await client.close(DIED, "what it was sent cannot be made any more")
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _until_gone(client: WebSocket) -> None:
    """Nothing is expected of it."""
    while (await client.receive())["type"] != "websocket.disconnect":
        pass
