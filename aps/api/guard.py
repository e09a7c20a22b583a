"""Who may use the API: hosts, origins, the token and sizes are looked at before any route is (ASGI).

Without a token the API is for programs of this machine. A page of another site that a browser on this machine shows is
none: it gives itself away by its Origin or by Sec-Fetch-Site, and one whose name was made to point here by its Host.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import ipaddress
import re
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import parse_qs, urlsplit

from starlette.exceptions import HTTPException

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

MAX_BODY_BYTES: Final = 4 << 20
TOKEN_VARIABLE: Final = "LOSTLINK_API_TOKEN"
"""Where programs take the token from: their options are shown to every user of the machine."""
LEAST_TOKEN_CHARS: Final = 16
TOKEN_CHARS: Final = re.compile(r"[A-Za-z0-9._~+/-]+=*")
"""``b64token`` of RFC 6750 (2.1): what a header and a cookie carry as it is."""
SCHEME: Final = re.compile(r"\ABearer +", re.IGNORECASE)
"""Of whatever case, and with one blank or more (RFC 9110, 11.1 and 11.4)."""
POLICY_VIOLATION: Final = 1008
"""WebSocket close code."""
HOLD_S: Final = 0.5
"""A connection whose request was refused is read again after this time: refusals cost the UA's event loop time too."""


def is_loopback(host: str) -> bool:
    """Whether an address or name is of this machine alone."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True, slots=True, kw_only=True)
class ApiConfig:
    """Settings of one API.

    Raises:
        ValueError: it would be open to other machines without a token, or the token is short or has characters that a
            header cannot carry.
    """

    host: str = "127.0.0.1"
    port: int = 0
    """0 takes any free one."""
    token: str = ""
    """What requests have to carry; needed when it listens beyond loopback."""
    hosts: tuple[str, ...] = ()
    """Names by which it may be reached, beside ``host``, addresses and localhost."""
    origins: tuple[str, ...] = ()
    """Web pages that may use it, such as ``https://gcs.example``, beside its own."""

    def __post_init__(self) -> None:
        if not self.token and not is_loopback(self.host):
            raise ValueError(f"an API on {self.host} can be reached from other machines: it needs a token")
        if not self.token:
            return
        if len(self.token) < LEAST_TOKEN_CHARS or not TOKEN_CHARS.fullmatch(self.token):
            raise ValueError(
                f"the token must have at least {LEAST_TOKEN_CHARS} characters: letters, digits and any of - . _ ~ + /"
            )


class Guard:
    """Refuses requests before they reach the app.

    Args:
        app: what is guarded.
        config: who may come.
        count: called with the reason of each refusal.
    """

    def __init__(self, app: App, config: ApiConfig, count: Callable[[str], object]) -> None:
        self._app, self._config, self._count = app, config, count

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        refusal = self._refusal(scope, headers)
        if refusal is None:
            await self._app(scope, self._limited(receive), send)
            return
        status, reason = refusal
        self._count(reason)
        if scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": POLICY_VIOLATION, "reason": reason})
        else:
            headers_too = [(b"www-authenticate", b"Bearer")] if status == 401 else []
            await refuse(scope, receive, send, status, f"refused: {reason}", headers_too)

    def _refusal(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str] | None:
        if not self._host_is_ours(headers.get("host", "")):
            return 421, "host"
        if not self._origin_may(headers):
            return 403, "origin"
        if not self._token_fits(scope, headers):
            return 401, "token"
        length = headers.get("content-length", "0")
        if not length.isdecimal() or len(length) > 12 or int(length) > MAX_BODY_BYTES:
            return 413, "size"
        return None

    def _host_is_ours(self, host: str) -> bool:
        """Addresses and our own names: no name of somebody else's that was made to point here."""
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        if name in (self._config.host.lower(), *self._config.hosts, "localhost"):
            return True
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return True

    def _origin_may(self, headers: dict[str, str]) -> bool:
        origin = headers.get("origin")
        if origin is None:
            return headers.get("sec-fetch-site", "none") in ("none", "same-origin")
        return origin in self._config.origins or origin in (
            f"http://{headers.get('host', '')}",
            f"https://{headers.get('host', '')}",
        )

    def _token_fits(self, scope: Scope, headers: dict[str, str]) -> bool:
        if not self._config.token:
            return True
        given = SCHEME.sub("", headers.get("authorization", ""))
        if not given:  # a browser's WebSocket cannot send headers
            query = parse_qs(scope.get("query_string", b"").decode("latin-1"))
            # A token has no blanks, and a + may come as it is.
            given = query.get("token", [""])[0].replace(" ", "+")
        return hmac.compare_digest(given.encode("utf-8"), self._config.token.encode("ascii"))

    def _limited(self, receive: Receive) -> Receive:
        """Refuses a body that has no length and turns out to be longer than it may be."""
        received = 0

        async def limited() -> MutableMapping[str, Any]:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > MAX_BODY_BYTES:
                self._count("size")
                raise HTTPException(413, "refused: size")
            return message

        return limited


async def refuse(
    scope: Scope,
    receive: Receive,
    send: Send,
    status: int,
    detail: str,
    headers: Iterable[tuple[bytes, bytes]] = (),
) -> None:
    """Answer with this status at once, and take the next request of this connection only after `HOLD_S`.

    A client that opens a WebSocket gets the answer in place of the handshake.
    """
    body = f'{{"detail":"{detail}"}}'.encode()
    told = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode()), *headers]
    kind = "websocket.http.response" if scope["type"] == "websocket" else "http.response"
    await send({"type": f"{kind}.start", "status": status, "headers": told})
    if scope["type"] == "websocket":
        await send({"type": f"{kind}.body", "body": body})
        return
    await send({"type": f"{kind}.body", "body": body, "more_body": True})
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(HOLD_S):
            await _until_gone(receive)
    await send({"type": f"{kind}.body", "body": b""})


async def _until_gone(receive: Receive) -> None:
    """Until the client hangs up; of a body that goes on no more is read."""
    while (message := await receive())["type"] != "http.disconnect":
        if message.get("more_body"):
            await asyncio.sleep(HOLD_S)
