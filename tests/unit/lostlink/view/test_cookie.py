"""Who brings the token how: in the address, as a cookie, as both."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from aps.api.guard import ApiConfig, Guard
from lostlink.view.cookie import COOKIE, WithCookie

TOKEN = "a-token-of-this-view"
STALE = f"{COOKIE}=the-token-of-another-view"
asked: list[str] = []
"""Query strings with which the page was reached."""


async def _page(scope: Any, _receive: Any, send: Any) -> None:
    asked.append(scope["query_string"].decode())
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"page"})


def answer(query: str = "", cookie: str = "", host: str = "127.0.0.1") -> tuple[int, str]:
    """Status, and the cookie that is set, of a request to a guarded page."""
    sent: list[Any] = []

    async def send(message: Any) -> None:
        sent.append(message)

    async def gone() -> dict[str, Any]:
        return {"type": "http.disconnect"}

    headers = [(b"host", host.encode()), *([(b"cookie", cookie.encode())] if cookie else [])]
    scope: dict[str, Any] = {"type": "http", "headers": headers, "query_string": query.encode()}
    scope["server"] = ("127.0.0.1", 8080)
    app = WithCookie(Guard(_page, ApiConfig(token=TOKEN), lambda _why: None), TOKEN)
    asyncio.run(app(scope, gone, send))
    return sent[0]["status"], dict(sent[0]["headers"]).get(b"set-cookie", b"").decode()


@pytest.mark.parametrize("cookie", ["", STALE, f"{COOKIE}={TOKEN}"])
def test_the_address_lets_in_and_sets_the_cookie_whatever_cookie_comes(cookie: str) -> None:
    status, given = answer(f"token={TOKEN}", cookie)
    assert status == 200
    assert given.startswith(f"{COOKIE}={TOKEN};")
    assert "HttpOnly; SameSite=Strict" in given


@pytest.mark.parametrize(("query", "left"), [("", ""), ("a=1%2B2&b=&", "a=1%2B2&b="), ("&EIO=4", "EIO=4")])
def test_the_token_goes_no_further(query: str, left: str) -> None:
    before, after = (query, "") if query.endswith("&") else ("", query)
    assert answer(f"{before}token={TOKEN}{after}")[0] == 200
    assert asked[-1] == left


def test_a_token_of_other_letters_is_refused() -> None:
    assert answer("token=%E2%82%ACa-token-of-this-view") == (401, "")
    assert answer("token=") == (401, "")


def test_a_cookie_that_fits_lets_in_and_one_that_does_not_is_taken_back() -> None:
    assert answer(cookie=f"{COOKIE}={TOKEN}") == (200, "")
    status, given = answer(cookie=STALE)
    assert status == 401
    assert given.startswith(f"{COOKIE}=; Max-Age=0;")


def test_a_wrong_address_does_not_take_a_good_cookie_away() -> None:
    assert answer("token=another-token-altogether", f"{COOKIE}={TOKEN}") == (401, "")
    assert answer() == (401, "")


@pytest.mark.parametrize("other", ['settings={"a":1}', "a b=1", "x", "name=J\u00f6rg", 'q="a;b"'])
def test_a_cookie_of_another_program_does_not_hide_it(other: str) -> None:
    """A browser sends those of all ports of a host."""
    assert answer(cookie=f"{other}; {COOKIE}={TOKEN}") == (200, "")
    assert answer(cookie=f"{COOKIE}={TOKEN}; {other}") == (200, "")


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "[::1]"])
def test_two_views_of_a_host_have_a_cookie_each(host: str) -> None:
    """By the ports that the browser knows: of tunnels to two machines both lead to the same one."""
    assert answer(f"token={TOKEN}", host=host)[1].startswith(f"{COOKIE}={TOKEN};")
    status, given = answer(f"token={TOKEN}", host=f"{host}:8081")
    assert (status, given.partition(";")[0]) == (200, f"{COOKIE}_8081={TOKEN}")
    both = f"{COOKIE}_8080=the-token-of-another-view; {COOKIE}_8081={TOKEN}"
    assert answer(cookie=both, host=f"{host}:8081") == (200, "")
    status, given = answer(cookie=both, host=f"{host}:8080")
    assert (status, given.partition(";")[0]) == (401, f"{COOKIE}_8080=")
