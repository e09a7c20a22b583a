"""The server of one UA's API, in the event loop of whoever starts it."""

from __future__ import annotations

import asyncio
import socket
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Self

import uvicorn

from aps.api.backend import Backend
from aps.api.guard import ApiConfig, Guard
from aps.api.routes import build

__all__ = ["ApiServer"]

BACKLOG = 64
STOP_S = 5.0
"""Until a server that does not end of itself is ended."""
MAX_CONNECTIONS = 64
MAX_FRAME_BYTES = 4096
"""Of what a client says on the stream, where nothing is expected."""


class _Server(uvicorn.Server):
    """uvicorn without its signal handlers: signals are the program's."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


class ApiServer:
    """An async context manager: it serves from entry to exit.

    Args:
        backend: the UA.
        config: where, and who may come.

    Raises:
        OSError: the port is taken (on entering the context).
    """

    def __init__(self, backend: Backend, config: ApiConfig) -> None:
        self.config = config
        self.refused: Counter[str] = Counter()
        """Requests that were refused, by reason: host, origin, token, size."""
        self._backend = backend
        self._task: asyncio.Task[None] | None = None
        self._port = 0

    @property
    def port(self) -> int:
        """TCP port."""
        return self._port

    async def __aenter__(self) -> Self:
        family = socket.AF_INET6 if ":" in self.config.host else socket.AF_INET
        listening = socket.create_server((self.config.host, self.config.port), family=family, backlog=BACKLOG)
        self._port = listening.getsockname()[1]
        app, self._stream = build(self._backend, has_token=bool(self.config.token))
        self._server = _Server(
            uvicorn.Config(
                Guard(app, self.config, self._count),
                lifespan="off",
                log_config=None,
                access_log=False,
                log_level="warning",
                ws="websockets-sansio",
                ws_max_size=MAX_FRAME_BYTES,
                limit_concurrency=MAX_CONNECTIONS,
                server_header=False,
                proxy_headers=False,
                timeout_graceful_shutdown=1,
            )
        )
        self._task = asyncio.create_task(self._server.serve(sockets=[listening]), name="api")
        return self

    def _count(self, reason: str) -> None:
        self.refused[reason] += 1

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._stream.close()
        self._server.should_exit = True
        if self._task is not None:
            await asyncio.wait({self._task}, timeout=STOP_S)
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
