"""The view's web server: NiceGUI behind the same guard as the HTTP API of the daemons, nothing from elsewhere."""

from __future__ import annotations

from collections import Counter
from functools import partial
from typing import Final, Self

from fastapi import FastAPI
from nicegui import ui

from aps.api.guard import ApiConfig, Guard
from aps.api.serving import Serving
from lostlink.view.background import Background
from lostlink.view.broadcast import Broadcast
from lostlink.view.cookie import App, Message, Receive, Scope, Send, WithCookie
from lostlink.view.page.page import Page, Shown
from lostlink.view.page.scene import FRAMES_PATH

POLICY: Final = (
    b"default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; style-src 'self' 'unsafe-inline'; "
    b"img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; frame-ancestors 'none'"
)
"""The browser itself refuses what would go elsewhere."""
RECONNECT_S: Final = 30.0
"""For so long a page that has lost its connection may come back as it was: a machine can be that busy."""
MAX_FRAME_BYTES: Final = 1 << 20
MAX_CONNECTIONS: Final = 256
"""A page has up to eight."""


class ViewServer:
    """An async context manager: it serves from entry to exit. One per process, as NiceGUI has it.

    Args:
        shown: what pages show.
        broadcast: serves the map's frames.
        config: where, and who may come.

    Attributes:
        background: what it lives by, from entry to exit; more can be added.

    Raises:
        OSError: the port is taken (on entering the context).
    """

    def __init__(self, shown: Shown, broadcast: Broadcast, config: ApiConfig) -> None:
        self.config = config
        self.port = 0
        self.refused: Counter[str] = Counter()
        self._shown, self._broadcast = shown, broadcast

    async def __aenter__(self) -> Self:
        self.background = Background()
        self._serving = Serving(
            WithCookie(Guard(_WithPolicy(self._app()), self.config, self._count), self.config.token),
            self.config.host,
            self.config.port,
            "view",
            MAX_CONNECTIONS,
            partial(self.background.die, "the web server"),
            lifespan="on",
            ws_max_size=MAX_FRAME_BYTES,
        )
        await self._serving.__aenter__()
        self.port = self._serving.port
        self.background.start(self._broadcast.run(), "the map")
        return self

    def _app(self) -> FastAPI:
        app = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)
        app.add_api_websocket_route(FRAMES_PATH, self._broadcast.serve)

        @ui.page("/", title=f"lostlink: {self._shown.name}")
        def page() -> None:
            Page(self._shown)

        ui.run_with(
            app,
            title="lostlink",
            dark=None,
            language="en-US",
            tailwind=False,
            show_welcome_message=False,
            reconnect_timeout=RECONNECT_S,
        )
        return app

    def _count(self, reason: str) -> None:
        self.refused[reason] += 1

    async def __aexit__(self, *_: object) -> None:
        await self.background.end()
        await self._serving.__aexit__()


class _WithPolicy:
    """Adds the content security policy to what is answered."""

    def __init__(self, app: App) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def with_policy(message: Message) -> None:
            if message["type"] == "http.response.start":
                more = [(b"content-security-policy", POLICY), (b"referrer-policy", b"no-referrer")]
                message["headers"] = [*message.get("headers", []), *more]
            await send(message)

        await self._app(scope, receive, with_policy)
