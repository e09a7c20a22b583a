"""The server of one UA's API, in the event loop of whoever starts it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Self

from aps.api.backend import DaemonBackend
from aps.api.guard import ApiConfig, Guard
from aps.api.pace import PacedApi
from aps.api.routes import build
from aps.api.serving import Serving

MAX_CONNECTIONS = 64
MAX_FRAME_BYTES = 4096
"""Of what a client says on the stream, where nothing is expected."""


class ApiServer:
    """An async context manager: it serves from entry to exit.

    Args:
        backend: the UA.
        config: where, and who may come.
        on_failure: called with the error if the server ends of itself.

    Raises:
        OSError: the port is taken (on entering the context).
    """

    def __init__(
        self,
        backend: DaemonBackend,
        config: ApiConfig,
        on_failure: Callable[[BaseException], object] = lambda _error: None,
    ) -> None:
        self.config = config
        self.refused: Counter[str] = Counter()
        """Requests that were refused, by reason: host, origin, token, size."""
        self._backend, self._on_failure = backend, on_failure
        self._serving: Serving | None = None

    @property
    def port(self) -> int:
        """TCP port."""
        return 0 if self._serving is None else self._serving.port

    async def __aenter__(self) -> Self:
        app, self._stream, self._jobs = build(self._backend, has_token=bool(self.config.token))
        serving = Serving(
            Guard(PacedApi(app), self.config, self._count),
            self.config.host,
            self.config.port,
            "api",
            MAX_CONNECTIONS,
            self._on_failure,
            lifespan="off",
            ws_max_size=MAX_FRAME_BYTES,
        )
        self._serving = await serving.__aenter__()
        return self

    def _count(self, reason: str) -> None:
        self.refused[reason] += 1

    async def __aexit__(self, *_: object) -> None:
        self._stream.close()
        self._jobs.close()
        if self._serving is not None:
            await self._serving.__aexit__()
