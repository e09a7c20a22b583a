"""The routes of the API, as a FastAPI application: every command of the daemon has one, made from its signature."""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import Callable
from dataclasses import asdict
from importlib import resources
from typing import Annotated, Any, Final

from fastapi import Body, FastAPI, HTTPException, Query, Request, WebSocket, WebSocketDisconnect
from fastapi.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from pydantic import BaseModel, ConfigDict, create_model

from aps.api.backend import Backend
from aps.api.jobs import Busy, Job, Jobs, result_json
from aps.api.stream import Listener, Stream, state_json
from aps.vehicle.commander import VERBS
from aps.vehicle.execution import CommandResult, Outcome
from aps.vehicle.missions.files import FlightPlan, read_plan, read_waypoints, write_plan, write_waypoints
from aps.vehicle.missions.items import KINDS, MissionItem
from aps.vehicle.parameters.files import compare, read_parameters, write_parameters

__all__ = ["build"]

STATUS: Final = {
    Outcome.REACHED: 200,
    Outcome.SUPERSEDED: 200,
    Outcome.REFUSED: 409,
    Outcome.INTERRUPTED: 409,
    Outcome.TIMED_OUT: 504,
}
"""How a command ended -> HTTP status."""
MAX_RATE_HZ: Final = 50.0
_FILE: Final = {"requestBody": {"required": True, "content": {"text/plain": {"schema": {"type": "string"}}}}}
"""OpenAPI's words for a body that is the text of a file."""


def build(backend: Backend) -> tuple[FastAPI, Stream]:
    """The application of one UA, and the stream that is to be closed with it."""
    app = FastAPI(
        title="lostlink: a UA's API",
        description="State, events, commands, missions, parameters and MAVLink of one UA.",
        docs_url=None,  # FastAPI's own pages load their scripts from another site
        redoc_url=None,
    )
    stream = Stream(backend)
    jobs = Jobs(backend, stream.tell)
    _add_looks(app, backend)
    _add_commands(app, jobs)
    _add_files(app, backend, jobs)
    _add_stream(app, stream, backend)
    return app, stream


def _add_looks(app: FastAPI, backend: Backend) -> None:
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
        "/messages/{name}", tags=["look"], summary="The last MAVLink message of a type, its age and rate"
    )
    async def message(name: str) -> dict[str, Any]:
        try:
            last = backend.last_message(name)
        except ValueError as error:
            raise HTTPException(404, str(error)) from error
        if last is None:
            raise HTTPException(404, f"no {name.upper()} has come; POST /commands/message asks for one")
        return asdict(last)


def _model(verb: str, make: Callable[..., Any]) -> type[BaseModel]:
    """The arguments of a verb as a model, from the signature of the function that makes it."""
    fields: dict[str, Any] = {}
    for parameter in list(inspect.signature(make, eval_str=True).parameters.values())[1:]:
        default = ... if parameter.default is inspect.Parameter.empty else parameter.default
        fields[parameter.name] = (parameter.annotation, default)
    name = "".join(part.capitalize() for part in verb.split("_"))
    return create_model(name, __config__=ConfigDict(extra="forbid", arbitrary_types_allowed=True), **fields)


def _answer(result: CommandResult) -> JSONResponse:
    return JSONResponse(result_json(result), STATUS[result.outcome])


def _started(jobs: Jobs, verb: str, arguments: dict[str, Any]) -> Job:
    try:
        return jobs.start(verb, arguments)
    except Busy as error:
        raise HTTPException(503, str(error)) from error
    except ValueError as error:
        raise HTTPException(422, str(error)) from error


async def _run(jobs: Jobs, verb: str, arguments: dict[str, Any]) -> Any:
    """Carry a command out; gives its value.

    Raises:
        HTTPException: it did not reach its goal.
    """
    result = await asyncio.shield(_started(jobs, verb, arguments).done)
    if not result.reached:
        raise HTTPException(STATUS[result.outcome], str(result))
    return result.value


def _add_commands(app: FastAPI, jobs: Jobs) -> None:
    @app.get("/commands", tags=["commands"], summary="Commands under way, and how the latest ended")
    async def commands() -> list[dict[str, Any]]:
        return [job.as_json() for job in jobs.all()]

    @app.get("/commands/{number}", tags=["commands"], summary="One command by its number")
    async def command(number: int) -> dict[str, Any]:
        job = jobs.get(number)
        if job is None:
            raise HTTPException(404, f"command {number} is not known, or not any more")
        return job.as_json()

    for verb, make in VERBS.items():
        _add_command(app, jobs, verb, make)


def _add_command(app: FastAPI, jobs: Jobs, verb: str, make: Callable[..., Any]) -> None:
    model = _model(verb, make)
    needed = any(field.is_required() for field in model.model_fields.values())
    default = Body() if needed else Body(default_factory=model)

    async def endpoint(arguments: Any = default, wait: bool = True) -> Response:
        given = {name: getattr(arguments, name) for name in arguments.model_fields_set}
        job = _started(jobs, verb, given)
        if not wait:
            return JSONResponse(job.as_json(), 202)
        return _answer(await asyncio.shield(job.done))

    endpoint.__annotations__["arguments"] = model
    text = inspect.getdoc(make) or ""
    app.post(
        f"/commands/{verb}",
        name=verb,
        tags=["commands"],
        summary=text.split("\n", 1)[0],
        description=text.replace("    state: the UA now.\n", ""),
        responses={
            202: {"description": "Started (wait=false): its number"},
            409: {"description": "Refused by the autopilot, or interrupted"},
            504: {"description": "Timed out"},
        },
    )(endpoint)


async def _read(read: Callable[[str], Any], request: Request) -> Any:
    try:
        return read((await request.body()).decode("utf-8"))
    except ValueError as error:
        raise HTTPException(422, str(error)) from error


def _add_files(app: FastAPI, backend: Backend, jobs: Jobs) -> None:
    async def download(kind: str) -> list[MissionItem]:
        items = await _run(jobs, "mission_download", {"kind": kind})
        return [MissionItem.from_json(item) for item in items]

    async def upload(items: list[MissionItem], kind: str) -> int:
        plain = [item.to_json() for item in items]
        return int(await _run(jobs, "mission_upload", {"items": plain, "kind": kind}))

    def home() -> tuple[float, float, float]:
        state = backend.state()
        place = (state.home_lat_deg, state.home_lon_deg, state.home_alt_amsl_m)
        return place if place[0] == place[0] else (0.0, 0.0, 0.0)

    @app.get("/plan", tags=["files"], summary="Mission, fence and rally points as QGroundControl's .plan")
    async def get_plan() -> Response:
        state = backend.state()
        lists = {kind: await download(kind) for kind in KINDS}
        plan = FlightPlan(lists["mission"], lists["fence"], lists["rally"], home())
        text = write_plan(plan, state.vehicle_type, state.autopilot)
        return PlainTextResponse(text, media_type="application/json")

    @app.put(
        "/plan",
        openapi_extra=_FILE,
        tags=["files"],
        summary="Upload a .plan: its mission, fence and rally points",
    )
    async def put_plan(request: Request) -> dict[str, int]:
        plan: FlightPlan = await _read(read_plan, request)
        return {kind: await upload(getattr(plan, kind), kind) for kind in KINDS}

    @app.get("/waypoints", tags=["files"], summary="The mission as a waypoint file")
    async def get_waypoints() -> PlainTextResponse:
        return PlainTextResponse(write_waypoints(await download("mission"), home()))

    @app.put("/waypoints", openapi_extra=_FILE, tags=["files"], summary="Upload a waypoint file")
    async def put_waypoints(request: Request) -> dict[str, int]:
        plan: FlightPlan = await _read(read_waypoints, request)
        return {"mission": await upload(plan.mission, "mission")}

    @app.get("/parameters", tags=["files"], summary="All parameters as a .parm file")
    async def get_parameters() -> PlainTextResponse:
        return PlainTextResponse(write_parameters(await _run(jobs, "parameters", {})))

    @app.put("/parameters", openapi_extra=_FILE, tags=["files"], summary="Set the parameters of a .parm file")
    async def put_parameters(request: Request) -> dict[str, int]:
        values = await _read(read_parameters, request)
        return {"set": int(await _run(jobs, "parameters_set", {"values": values}))}

    @app.post(
        "/parameters/compare",
        openapi_extra=_FILE,
        tags=["files"],
        summary="How a .parm file differs from the autopilot",
    )
    async def compare_parameters(request: Request) -> list[dict[str, Any]]:
        ours = await _read(read_parameters, request)
        theirs = await _run(jobs, "parameters", {})
        return [
            {"name": name, "file": mine, "autopilot": other}
            for name, mine, other in compare(ours, theirs)
            if mine is not None
        ]


def _add_stream(app: FastAPI, stream: Stream, backend: Backend) -> None:
    @app.websocket("/stream")
    async def serve(
        socket: WebSocket,
        rate_hz: Annotated[float, Query(ge=0.0, le=MAX_RATE_HZ)] = 5.0,
        messages: str = "",
    ) -> None:
        """State, texts, MAVLink messages, and progress and results of commands."""
        names = [name for name in messages.split(",") if name]
        await socket.accept()
        try:
            for name in names:
                backend.last_message(name)
        except ValueError as error:
            await socket.close(1008, str(error))
            return
        listener = Listener(rate_hz, names)
        if not stream.add(listener):
            await socket.close(1013, "too many listeners")
            return
        sender = asyncio.create_task(_send(socket, listener))
        try:
            while True:
                await socket.receive_text()  # nothing is expected: this ends with the connection
        except (WebSocketDisconnect, KeyError, RuntimeError):
            return
        finally:
            stream.remove(listener)
            sender.cancel()
            await asyncio.gather(sender, return_exceptions=True)


async def _send(socket: WebSocket, listener: Listener) -> None:
    while True:
        await socket.send_text(await listener.next())
