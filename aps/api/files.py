"""The part of the API that is about files: missions as .plan and waypoint files, parameters as .parm files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from fastapi import FastAPI, HTTPException, Request
from fastapi.responses import PlainTextResponse, Response
from starlette.requests import ClientDisconnect

from aps.api.backend import DaemonBackend
from aps.api.commands import ENDINGS, run
from aps.api.jobs import Jobs
from aps.vehicle.missions.files import (
    FlightPlan,
    jumps_moved,
    read_plan,
    read_waypoints,
    write_plan,
    write_waypoints,
)
from aps.vehicle.missions.items import KINDS, MissionItem, first_seq
from aps.vehicle.parameters.files import compare, read_parameters, write_parameters

_FILE: Final = {"requestBody": {"required": True, "content": {"text/plain": {"schema": {"type": "string"}}}}}
"""OpenAPI's words for a body that is the text of a file."""
_FILE_ENDINGS: Final = {**ENDINGS, 422: {"description": "The file cannot be read: line and reason"}}


async def _read(read: Callable[[str], Any], request: Request) -> Any:
    try:
        return read((await request.body()).decode("utf-8"))
    except ValueError as error:
        raise HTTPException(422, str(error)) from error
    except ClientDisconnect as error:
        raise HTTPException(400, "the client hung up") from error  # nobody gets it


def add_files(app: FastAPI, backend: DaemonBackend, jobs: Jobs) -> None:
    """Add the routes."""
    lists = _Lists(backend, jobs)
    _add_plan(app, lists)
    _add_waypoints(app, lists)
    _add_parameters(app, jobs)


@dataclass(frozen=True, slots=True)
class _Lists:
    """Missions, fences and rally points of the autopilot."""

    backend: DaemonBackend
    jobs: Jobs

    async def download(self, kind: str) -> list[MissionItem]:
        """A list as files have it."""
        items = await run(self.jobs, "mission_download", {"kind": kind})
        return jumps_moved([MissionItem.from_json(item) for item in items], 1 - self._first)

    async def upload(self, items: list[MissionItem], kind: str) -> int:
        """A list that was in a file."""
        plain = [item.to_json() for item in jumps_moved(items, self._first - 1)]
        return int(await run(self.jobs, "mission_upload", {"items": plain, "kind": kind}))

    @property
    def _first(self) -> int:
        """The autopilot's number of the first item after home, which is 1 in files."""
        return first_seq(KINDS["mission"], self.backend.state().autopilot)

    def home(self) -> tuple[float, float, float]:
        state = self.backend.state()
        place = (state.home_lat_deg, state.home_lon_deg, state.home_alt_amsl_m)
        return place if place[0] == place[0] else (0.0, 0.0, 0.0)


def _add_plan(app: FastAPI, lists: _Lists) -> None:
    @app.get(
        "/plan",
        responses=ENDINGS,
        tags=["files"],
        summary="Mission, fence and rally points as QGroundControl's .plan",
    )
    async def get_plan() -> Response:
        state = lists.backend.state()
        found = {kind: await lists.download(kind) for kind in KINDS}
        plan = FlightPlan(found["mission"], found["fence"], found["rally"], lists.home())
        try:
            text = write_plan(plan, state.vehicle_type, state.autopilot)
        except ValueError as error:  # the autopilot has what no plan can hold
            raise HTTPException(409, str(error)) from error
        return PlainTextResponse(text, media_type="application/json")

    @app.put(
        "/plan",
        openapi_extra=_FILE,
        responses=_FILE_ENDINGS,
        tags=["files"],
        summary="Upload a .plan: its mission, fence and rally points",
    )
    async def put_plan(request: Request) -> dict[str, int]:
        plan: FlightPlan = await _read(read_plan, request)
        return {kind: await lists.upload(getattr(plan, kind), kind) for kind in KINDS}


def _add_waypoints(app: FastAPI, lists: _Lists) -> None:
    @app.get("/waypoints", responses=ENDINGS, tags=["files"], summary="The mission as a waypoint file")
    async def get_waypoints() -> PlainTextResponse:
        return PlainTextResponse(write_waypoints(await lists.download("mission"), lists.home()))

    @app.put(
        "/waypoints",
        openapi_extra=_FILE,
        responses=_FILE_ENDINGS,
        tags=["files"],
        summary="Upload a waypoint file",
    )
    async def put_waypoints(request: Request) -> dict[str, int]:
        plan: FlightPlan = await _read(read_waypoints, request)
        return {"mission": await lists.upload(plan.mission, "mission")}


def _add_parameters(app: FastAPI, jobs: Jobs) -> None:
    @app.get("/parameters", responses=ENDINGS, tags=["files"], summary="All parameters as a .parm file")
    async def get_parameters() -> PlainTextResponse:
        return PlainTextResponse(write_parameters(await run(jobs, "parameters", {})))

    @app.put(
        "/parameters",
        openapi_extra=_FILE,
        responses=_FILE_ENDINGS,
        tags=["files"],
        summary="Set the parameters of a .parm file",
    )
    async def put_parameters(request: Request) -> dict[str, int]:
        values = await _read(read_parameters, request)
        return {"set": int(await run(jobs, "parameters_set", {"values": values}))}

    @app.post(
        "/parameters/compare",
        openapi_extra=_FILE,
        responses=_FILE_ENDINGS,
        tags=["files"],
        summary="How a .parm file differs from the autopilot",
    )
    async def compare_parameters(request: Request) -> list[dict[str, Any]]:
        ours = await _read(read_parameters, request)
        theirs = await run(jobs, "parameters", {})
        return [
            {"name": name, "file": mine, "autopilot": other}
            for name, mine, other in compare(ours, theirs)
            if mine is not None
        ]
