"""What dies while it serves says so, and ends what it serves."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Callable
from typing import Any

import pytest
from starlette.websockets import WebSocket

from aps.api import serving as serving_module
from aps.api.serving import BACKLOG, DIED, Serving, serve_client


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
    async with Serving(None, "127.0.0.1", 0, "view", 8, died.set_result):
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

    async with Serving(app, "127.0.0.1", 0, "api", 8, lifespan="off") as serving:
        reader, writer = await asyncio.open_connection("127.0.0.1", serving.port)
        writer.write(b"GET / HTTP/1.1\r\nHost: here\r\n\r\n")
        assert b"204" in await asyncio.wait_for(reader.readline(), 5.0)
        writer.close()
    assert no_delay == [True]


async def test_a_server_that_is_told_to_end_does_not_die() -> None:
    told: list[BaseException] = []
    on_failure: Callable[[BaseException], None] = told.append
    async with Serving(None, "127.0.0.1", 0, "view", 8, on_failure, lifespan="off"):
        await asyncio.sleep(0.05)
    assert told == []


REQUEST = b"GET / HTTP/1.1\r\nHost: here\r\n\r\n"
Connection = tuple[asyncio.StreamReader, asyncio.StreamWriter]


async def nothing(_scope: Any, _receive: Any, send: Any) -> None:
    await send({"type": "http.response.start", "status": 204, "headers": []})
    await send({"type": "http.response.body"})


async def answer(connection: Connection) -> bytes:
    """The first line of what is answered; empty if the connection has ended."""
    connection[1].write(REQUEST)
    return await first_line(connection)


async def first_line(connection: Connection) -> bytes:
    try:
        return await asyncio.wait_for(connection[0].readline(), 5.0)
    except ConnectionResetError:
        return b""


async def test_connections_beyond_the_most_end_though_they_never_ask() -> None:
    async with Serving(nothing, "127.0.0.1", 0, "api", 3, lifespan="off") as serving:
        some = [await asyncio.open_connection("127.0.0.1", serving.port) for _ in range(6)]
        assert [await first_line(each) for each in some[3:]] == [b""] * 3
        assert len(serving._server.server_state.connections) == 3
        assert b"503" in await answer(some[2])
        assert b"204" in await answer(some[0])
        assert serving._server.config.backlog == BACKLOG
        for _, writer in some:
            writer.close()


@pytest.mark.parametrize("begins_with", [b"", REQUEST])
async def test_a_connection_that_never_ends_a_head_is_closed(
    monkeypatch: pytest.MonkeyPatch, begins_with: bytes
) -> None:
    monkeypatch.setattr(serving_module, "HEAD_S", 0.2)

    async def dribble(writer: asyncio.StreamWriter) -> None:
        writer.write(begins_with + b"GET / HTTP/1.1\r\nHost: here\r\nX: ")
        while not writer.is_closing():
            writer.write(b"x")
            await asyncio.sleep(0.02)

    async with Serving(nothing, "127.0.0.1", 0, "api", 8, lifespan="off") as serving:
        reader, writer = await asyncio.open_connection("127.0.0.1", serving.port)
        dribbling = asyncio.create_task(dribble(writer))
        with contextlib.suppress(ConnectionResetError):
            await asyncio.wait_for(reader.read(), 5.0)
        dribbling.cancel()
        assert not serving._server.server_state.connections
        writer.close()


async def test_a_request_that_takes_long_is_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serving_module, "HEAD_S", 0.02)

    async def slow(scope: Any, receive: Any, send: Any) -> None:
        await asyncio.sleep(0.3)
        await nothing(scope, receive, send)

    async with Serving(slow, "127.0.0.1", 0, "api", 8, lifespan="off") as serving:
        connection = await asyncio.open_connection("127.0.0.1", serving.port)
        assert b"204" in await answer(connection)
        connection[1].close()
