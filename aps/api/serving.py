"""An ASGI application served in the event loop of whoever starts it, at one address, until it is told to end."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Self

import uvicorn

__all__ = ["Serving"]

BACKLOG = 64
STOP_S = 5.0
"""Until a server that does not end of itself is ended."""


class _Server(uvicorn.Server):
    """uvicorn without its signal handlers: signals are the program's."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


class Serving:
    """An async context manager: it serves from entry to exit, says nothing of requests, and tells nobody what it is.

    Args:
        app: the application.
        host: address or name to listen at.
        port: TCP port; 0 for any free one.
        name: of its task.
        settings: further ones of `uvicorn.Config`.

    Attributes:
        port: where it listens.

    Raises:
        OSError: the port is taken (on entering the context).
    """

    def __init__(self, app: Any, host: str, port: int, name: str, **settings: Any) -> None:
        self.port = port
        self._host, self._name = host, name
        self._server = _Server(
            uvicorn.Config(
                app,
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
        listening = socket.create_server((self._host, self.port), family=family, backlog=BACKLOG)
        self.port = listening.getsockname()[1]
        self._task = asyncio.create_task(self._server.serve(sockets=[listening]), name=self._name)
        return self

    async def __aexit__(self, *_: object) -> None:
        self._server.should_exit = True
        await asyncio.wait({self._task}, timeout=STOP_S)
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
