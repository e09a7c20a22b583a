"""The token of a view as a cookie, so that a browser has to bring it in an address only once (ASGI)."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any, Final
from urllib.parse import parse_qs

COOKIE: Final = "lostlink_view"
Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]


class WithCookie:
    """Gives a browser the token as a cookie when ``?token=`` fitted, and takes it back when it fits no more.

    Where both come, ``?token=`` counts: a cookie may be that of an earlier view at the same address.

    Args:
        app: looks at tokens (`aps.api.guard.Guard`).
        token: the right one; "" if none is needed.
    """

    def __init__(self, app: App, token: str) -> None:
        self._app, self._token = app, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        if not self._token or scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = dict(scope["headers"])
        asked = "token" in parse_qs(scope.get("query_string", b"").decode("latin-1"))
        brought = "" if asked else _cookie(headers.get(b"cookie", b"").decode("latin-1"))
        if brought and b"authorization" not in headers:
            bearer = (b"authorization", f"Bearer {brought}".encode("latin-1"))
            scope = {**scope, "headers": [*scope["headers"], bearer]}

        async def with_cookie(message: Message) -> None:
            if message["type"] == "http.response.start":
                if asked and message["status"] == 200:
                    _set(message, self._token)
                elif brought and message["status"] == 401:
                    _set(message, "; Max-Age=0")
            await send(message)

        await self._app(scope, receive, with_cookie)


def _set(message: Message, value: str) -> None:
    cookie = f"{COOKIE}={value}; HttpOnly; SameSite=Strict; Path=/".encode("ascii")
    message["headers"] = [*message.get("headers", []), (b"set-cookie", cookie)]


def _cookie(header: str) -> str:
    try:
        found = SimpleCookie(header).get(COOKIE)
    except CookieError:
        return ""
    return found.value if found else ""
