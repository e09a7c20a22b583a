"""The token of a view as a cookie, so that a browser has to bring it in an address only once (ASGI)."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any, Final
from urllib.parse import parse_qsl, urlencode

COOKIE: Final = "lostlink_view"
"""With the port behind it that a browser asked: it sends a host's cookies to all of its ports."""
Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]


class WithCookie:
    """Gives a browser the token as a cookie when ``?token=`` fitted, and takes it back when it fits no more.

    Where both come, ``?token=`` counts: a cookie may be that of an earlier view at the same address. Behind it no
    address has the token: NiceGUI logs those that it does not know.

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
        query = parse_qsl(scope.get("query_string", b"").decode("latin-1"), keep_blank_values=True)
        asked = next((value for key, value in query if key == "token" and value), "")
        name = _name(headers.get(b"host", b"").decode("latin-1"))
        brought = "" if asked else _cookie(headers.get(b"cookie", b"").decode("latin-1"), name)
        others = urlencode([(key, value) for key, value in query if key != "token"])
        scope = {**scope, "query_string": others.encode("ascii")}
        if (asked or brought) and b"authorization" not in headers:
            bearer = (b"authorization", f"Bearer {asked or brought}".encode())
            scope["headers"] = [*scope["headers"], bearer]

        async def with_cookie(message: Message) -> None:
            if message["type"] == "http.response.start":
                if asked and message["status"] == 200:
                    _set(message, name, self._token)
                elif brought and message["status"] == 401:
                    _set(message, name, "; Max-Age=0")
            await send(message)

        await self._app(scope, receive, with_cookie)


def _name(host: str) -> str:
    """What the cookie is called at a browser's ``host:port``; a tunnel's port may be another than the server's."""
    port = host.rpartition(":")[2]
    return f"{COOKIE}_{port}" if port.isdecimal() and port.isascii() else COOKIE


def _set(message: Message, name: str, value: str) -> None:
    cookie = f"{name}={value}; HttpOnly; SameSite=Strict; Path=/".encode("ascii")
    message["headers"] = [*message.get("headers", []), (b"set-cookie", cookie)]


def _cookie(header: str, name: str) -> str:
    """The value of a cookie among those that a browser sends, some of which other programs may have set; "" of none."""
    pairs = (each.strip().partition("=") for each in header.split(";"))
    return next((value for found, _, value in pairs if found == name), "")
