"""The part of the API that carries out commands: each verb of the daemon has a route, made from its signature."""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import Callable
from typing import Any, Final

from fastapi import Body, FastAPI, HTTPException
from fastapi.responses import JSONResponse, Response
from pydantic import BaseModel, ConfigDict, create_model

from aps.api.jobs import Busy, Job, Jobs, result_json
from aps.vehicle.commander import VERBS
from aps.vehicle.execution import CommandResult, Outcome

STATUS: Final = {
    Outcome.REACHED: 200,
    Outcome.SUPERSEDED: 200,
    Outcome.REFUSED: 409,
    Outcome.INTERRUPTED: 409,
    Outcome.TIMED_OUT: 504,
}
"""How a command ended -> HTTP status."""
ENDINGS: Final[dict[int | str, dict[str, Any]]] = {
    409: {"description": "Refused by the autopilot, or interrupted"},
    503: {"description": "Too many commands are under way"},
    504: {"description": "Timed out"},
}
_UNREADABLE: Final[dict[int | str, dict[str, Any]]] = {
    400: {"description": "The body is not UTF-8, or nested too deep"}
}
UNKNOWN: Final[dict[int | str, dict[str, Any]]] = {404: {"description": "There is none"}}


def _model(verb: str, make: Callable[..., Any]) -> type[BaseModel]:
    """The arguments of a verb as a model, from the signature of the function that makes it."""
    fields: dict[str, Any] = {}
    for parameter in list(inspect.signature(make, eval_str=True).parameters.values())[1:]:
        default = ... if parameter.default is inspect.Parameter.empty else parameter.default
        fields[parameter.name] = (parameter.annotation, default)
    name = "".join(part.capitalize() for part in verb.split("_"))
    config = ConfigDict(extra="forbid", arbitrary_types_allowed=True, strict=True)  # true is no number
    return create_model(name, __config__=config, **fields)


def _answer(result: CommandResult) -> JSONResponse:
    return JSONResponse(result_json(result), STATUS[result.outcome])


def _started(jobs: Jobs, verb: str, arguments: dict[str, Any]) -> Job:
    try:
        return jobs.start(verb, arguments)
    except Busy as error:
        raise HTTPException(503, str(error)) from error
    except ValueError as error:
        raise HTTPException(422, str(error)) from error


async def run(jobs: Jobs, verb: str, arguments: dict[str, Any]) -> Any:
    """Carry a command out; gives its value.

    Raises:
        HTTPException: it did not reach its goal.
    """
    result = await asyncio.shield(_started(jobs, verb, arguments).done)
    if not result.reached:
        raise HTTPException(STATUS[result.outcome], str(result))
    return result.value


def add_commands(app: FastAPI, jobs: Jobs) -> None:
    """Add the routes."""

    @app.get("/commands", tags=["commands"], summary="Commands under way, and how the latest ended")
    async def commands() -> list[dict[str, Any]]:
        return [job.as_json() for job in jobs.all()]

    @app.get("/commands/{number}", responses=UNKNOWN, tags=["commands"], summary="One command by its number")
    async def command(number: int) -> dict[str, Any]:
        job = jobs.get(number)
        if job is None:
            raise HTTPException(404, f"command {number} is not known, or not any more")
        return job.as_json()

    for verb, make in VERBS.items():
        _add_command(app, jobs, verb, make)

    @app.post("/commands/{verb}", include_in_schema=False)
    async def unknown(verb: str) -> None:
        raise HTTPException(404, f"there is no command {verb!r}; there are {', '.join(VERBS)}")


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
        responses={202: {"description": "Started (wait=false): its number"}, **_UNREADABLE, **ENDINGS},
    )(endpoint)
