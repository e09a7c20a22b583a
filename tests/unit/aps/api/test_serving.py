"""What dies while it serves says so, and ends what it serves."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from typing import Any

import pytest
from starlette.websockets import WebSocket

from aps.api.serving import DIED, Serving, serve_client


class Client:
    """A WebSocket's other end, which was accepted and says nothing until it goes."""

    def __init__(self) -> None:
        self.sent: list[dict[str, Any]] = []
        self.gone = asyncio.Event()
        self._connects = True

    async def receive(self) -> dict[str, Any]:
        if self._connects:
            self._connects = False
            return {"type": "websocket.connect"}
        await self.gone.wait()
        return {"type": "websocket.disconnect", "code": 1000}

    async def send(self, message: Any) -> None:
        self.sent.append(dict(message))

    async def accepted(self) -> WebSocket:
        client = WebSocket({"type": "websocket"}, self.receive, self.send)
        await client.accept()
        return client


async def lives() -> None:
    await asyncio.Event().wait()


async def dies() -> None:
    raise KeyError("speed")


async def test_a_client_whose_stream_dies_is_told(caplog: pytest.LogCaptureFixture) -> None:
    client = Client()
    await asyncio.wait_for(serve_client(await client.accepted(), lives(), dies()), 5.0)
    assert (client.sent[-1]["type"], client.sent[-1]["code"]) == ("websocket.close", DIED)
    assert "a client is served no more" in caplog.text


async def test_a_client_that_goes_is_no_death(caplog: pytest.LogCaptureFixture) -> None:
    client = Client()
    client.gone.set()
    await asyncio.wait_for(serve_client(await client.accepted(), lives()), 5.0)
    assert [message["type"] for message in client.sent] == ["websocket.accept"]
    assert caplog.text == ""


@pytest.mark.parametrize("raises", [True, False])
async def test_a_server_that_ends_of_itself_is_told_of(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch, raises: bool
) -> None:
    async def ends(*_: object, **__: object) -> None:
        if raises:
            raise KeyError("speed")

    monkeypatch.setattr("uvicorn.Server.serve", ends)
    died: asyncio.Future[BaseException] = asyncio.get_running_loop().create_future()
    async with Serving(None, "127.0.0.1", 0, "view", died.set_result):
        error = await asyncio.wait_for(died, 5.0)
    assert ("speed" in str(error)) if raises else ("the view ended of itself" in str(error))
    assert "nothing is served at port" in caplog.text


async def test_what_is_sent_on_a_connection_does_not_wait_for_more() -> None:
    no_delay: list[bool] = []

    async def app(_scope: Any, _receive: Any, send: Any) -> None:
        connections = serving._server.server_state.connections
        sockets = [connection.transport.get_extra_info("socket") for connection in connections]
        no_delay.extend(bool(s.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)) for s in sockets)
        await send({"type": "http.response.start", "status": 204, "headers": []})
        await send({"type": "http.response.body"})

    async with Serving(app, "127.0.0.1", 0, "api", lifespan="off") as serving:
        reader, writer = await asyncio.open_connection("127.0.0.1", serving.port)
        writer.write(b"GET / HTTP/1.1\r\nHost: here\r\n\r\n")
        assert b"204" in await asyncio.wait_for(reader.readline(), 5.0)
        writer.close()
    assert no_delay == [True]


async def test_a_server_that_is_told_to_end_does_not_die() -> None:
    told: list[BaseException] = []
    on_failure: Callable[[BaseException], None] = told.append
    async with Serving(None, "127.0.0.1", 0, "view", on_failure, lifespan="off"):
        await asyncio.sleep(0.05)
    assert told == []
