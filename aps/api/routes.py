"""The API of one UA as a FastAPI application: what there is to look at, and the stream; the other routes by part."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from importlib import resources
from typing import Annotated, Any, Final

from fastapi import FastAPI, HTTPException, Query, Request, WebSocket
from fastapi.exceptions import RequestValidationError, WebSocketRequestValidationError
from fastapi.responses import HTMLResponse, JSONResponse

from aps.api.backend import DaemonBackend
from aps.api.commands import UNKNOWN, add_commands
from aps.api.files import add_files
from aps.api.guard import POLICY_VIOLATION
from aps.api.jobs import Jobs
from aps.api.links import add_links
from aps.api.serving import serve_client
from aps.api.stream import ApiStream, Listener, state_json

MAX_RATE_HZ: Final = 50.0
MAX_STATUS_HZ: Final = 10.0
MAX_MISTAKES: Final = 20
MAX_CHARS: Final = 200
"""Of what a client sent, that it is told again."""
NO_JSON: Final = "A body is taken for JSON only with the header Content-Type: application/json"
MAX_REASON_BYTES: Final = 123
"""Of a WebSocket's close frame (RFC 6455, 5.5)."""


def build(backend: DaemonBackend, *, has_token: bool = False) -> tuple[FastAPI, ApiStream, Jobs]:
    """The application of one UA, and the stream and the commands that are to be closed with it.

    Args:
        backend: the UA.
        has_token: whether whoever gets this far has shown a token.
    """
    app = FastAPI(
        title="lostlink: a UA's API",
        description="State, events, commands, missions, parameters and MAVLink of one UA.",
        docs_url=None,  # FastAPI's own pages load their scripts from another site
        redoc_url=None,
    )
    app.add_exception_handler(RequestValidationError, _refused)
    app.add_exception_handler(WebSocketRequestValidationError, _stream_refused)  # type: ignore[arg-type]
    stream = ApiStream(backend)
    jobs = Jobs(backend, stream.tell)
    _add_looks(app, backend)
    add_links(app, backend, has_token=has_token)
    add_commands(app, jobs)
    add_files(app, backend, jobs)
    _add_stream(app, stream, backend)
    return app, stream, jobs


async def _refused(_request: Request, error: Exception) -> JSONResponse:
    """Say which arguments are wrong, whatever they are: not all that a request can hold is JSON (NaN, lone bytes)."""
    assert isinstance(error, RequestValidationError), "registered for it"
    told = [
        {
            "type": one["type"],
            "loc": [step if isinstance(step, int) else _sendable(step) for step in one["loc"]],
            "msg": NO_JSON if isinstance(one["input"], bytes) else _sendable(one["msg"]),
            "input": _sendable(repr(one["input"])),
        }
        for one in error.errors()[:MAX_MISTAKES]
    ]
    return JSONResponse({"detail": told}, 422)


async def _stream_refused(socket: WebSocket, error: WebSocketRequestValidationError) -> None:
    """Say which argument of the stream is wrong: before it is accepted, no reason can be given."""
    first = error.errors()[0]
    await socket.accept()
    await _close(socket, f"{first['loc'][-1]}={first['input']}: {first['msg']}")


async def _close(socket: WebSocket, mistake: str) -> None:
    await socket.close(POLICY_VIOLATION, mistake.encode()[:MAX_REASON_BYTES].decode(errors="ignore"))


def _sendable(text: str) -> str:
    return text[:MAX_CHARS].encode("utf-8", "backslashreplace").decode("utf-8")


def _add_looks(app: FastAPI, backend: DaemonBackend) -> None:
    page = (resources.files("aps.api") / "page.html").read_text(encoding="utf-8")

    @app.get("/", include_in_schema=False)
    async def index() -> HTMLResponse:
        return HTMLResponse(page)

    @app.get("/state", tags=["look"], summary="The state (Table I), and the age of each field")
    async def state() -> dict[str, Any]:
        return state_json(backend.state())

    @app.get("/statistics", tags=["look"], summary="Counters of links, routes, streams and commands")
    async def statistics() -> dict[str, Any]:
        return backend.statistics()

    @app.get("/messages", tags=["look"], summary="Names of the MAVLink messages that the autopilot has sent")
    async def messages() -> list[str]:
        return backend.message_names()

    @app.get(
        "/messages/{name}",
        responses=UNKNOWN,
        tags=["look"],
        summary="The last MAVLink message of a type, its age and rate",
    )
    async def message(name: str) -> dict[str, Any]:
        try:
            last = backend.last_message(name)
        except ValueError as error:
            raise HTTPException(404, str(error)) from error
        if last is None:
            raise HTTPException(404, f"no {name.upper()} has come; POST /commands/message asks for one")
        return asdict(last)


def _add_stream(app: FastAPI, stream: ApiStream, backend: DaemonBackend) -> None:
    @app.websocket("/stream")
    async def serve(
        socket: WebSocket,
        rate_hz: Annotated[float, Query(ge=0.0, le=MAX_RATE_HZ)] = 5.0,
        messages: str = "",
        status_hz: Annotated[float, Query(ge=0.0, le=MAX_STATUS_HZ)] = 0.0,
    ) -> None:
        """Events, a JSON object each; ``type`` says which.

        ``state`` (as of GET /state) and ``message`` (as of GET /messages/NAME) come at up to ``rate_hz``, ``status``
        (as of GET /status) at ``status_hz``, each ``text`` of the autopilot (``severity``, ``text``), and ``progress``
        and ``result`` of commands that came over the API, with their ``id``. A client that reads too slowly gets the
        newest, and ``missed`` with the number of the others (``events``). Nothing is expected from the client. A token
        may be given as ``token`` in the query.

        Args:
            socket: the client.
            rate_hz: how often states and messages come at most, by wall time, 0 to 50; 0: never.
            messages: names of MAVLink messages, with commas: ATTITUDE,WIND.
            status_hz: how often the status comes, 0 to 10; 0: never.
        """
        names = [name for name in messages.split(",") if name]
        await socket.accept()
        try:
            for name in names:
                backend.last_message(name)
        except ValueError as error:
            await _close(socket, str(error))
            return
        listener = Listener(rate_hz, names)
        if not stream.add(listener):
            await socket.close(1013, "too many listeners")
            return
        works = [_send(socket, listener)]
        if status_hz:
            works.append(_tell_status(backend, listener, 1.0 / status_hz))
        try:
            await serve_client(socket, *works)
        finally:
            stream.remove(listener)


async def _send(socket: WebSocket, listener: Listener) -> None:
    while True:
        await socket.send_text(await listener.next())


async def _tell_status(backend: DaemonBackend, listener: Listener, period_s: float) -> None:
    """By wall time: an autopilot that is silent shows, too."""
    while True:
        listener.put({"type": "status", **backend.status()})
        await asyncio.sleep(period_s)
