"""Who may come: names by which an API is reached, and what a token may be."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from aps.api.guard import ApiConfig, Guard

TOKEN = "a-token/of+this.test=="


def status(config: ApiConfig, host: str, token: str = TOKEN, scheme: str = "Bearer ", query: str = "") -> int:
    sent: list[Any] = []

    async def app(_scope: Any, _receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200})

    async def send(message: Any) -> None:
        sent.append(message)

    async def receive() -> dict[str, Any]:
        return {"type": "http.disconnect"}

    headers = [(b"host", host.encode()), (b"authorization", f"{scheme}{token}".encode())]
    scope = {"type": "http", "headers": headers, "query_string": query.encode()}
    asyncio.run(Guard(app, config, lambda _why: None)(scope, receive, send))  # type: ignore[arg-type]
    return int(sent[0]["status"])


def test_it_is_reached_by_the_name_at_which_it_listens() -> None:
    config = ApiConfig(host="Ground.example", token=TOKEN)
    assert status(config, "ground.example:8080") == 200
    assert status(config, "ground.example:8080", "another-token-altogether") == 401
    assert status(config, "rebound.example:8080") == 421


@pytest.mark.parametrize("scheme", ["Bearer ", "bearer ", "BEARER  "])
def test_the_scheme_of_a_token_may_have_any_case(scheme: str) -> None:
    """RFC 9110, 11.1 and 11.4."""
    assert status(ApiConfig(token=TOKEN), "127.0.0.1", TOKEN, scheme) == 200
    assert status(ApiConfig(token=TOKEN), "127.0.0.1", TOKEN, "Basic ") == 401


@pytest.mark.parametrize("given", ["a-token/of+this.test==", "a-token%2Fof%2Bthis.test%3D%3D"])
def test_a_token_in_the_query_comes_as_it_is_or_encoded(given: str) -> None:
    config = ApiConfig(token=TOKEN)
    assert status(config, "127.0.0.1", "", "", f"rate_hz=5&token={given}") == 200
    assert status(config, "127.0.0.1", "", "", f"token={given}x") == 401


@pytest.mark.parametrize(
    "wrong", ["short", "a-token;of this test", "a-token-of-this-test&more", "a=token-of-this-test"]
)
def test_a_token_is_long_and_fits_in_a_header(wrong: str) -> None:
    with pytest.raises(ValueError, match="at least 16 characters"):
        ApiConfig(token=wrong)
