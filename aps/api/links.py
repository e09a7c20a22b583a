"""The part of the API that is about links: where they are opened, what came over them, opening and ending them."""

from __future__ import annotations

from typing import Any, Final

from fastapi import FastAPI, HTTPException, Response
from pydantic import BaseModel, ConfigDict, Field

from aps.api.backend import DaemonBackend
from aps.api.guard import is_loopback
from aps.links.address import parse_address

MAX_OPENED: Final = 32


class NewLinks(BaseModel):
    """Where to open links."""

    model_config = ConfigDict(extra="forbid")

    address: str = Field(description="as in settings, with rules: ``udp-out:127.0.0.1:14551,max-hz=*:2``")


def add_links(app: FastAPI, backend: DaemonBackend, *, has_token: bool) -> None:
    """Add the routes.

    Args:
        app: the application.
        backend: the UA.
        has_token: whether whoever comes here has shown a token. Without one, links are opened on this machine only:
            MAVLink has no access control, and who may use the API must not thereby let in everybody else.
    """

    @app.get("/status", tags=["links"], summary="State and all counters: what lostlink aps status shows")
    async def status() -> dict[str, Any]:
        return backend.status()

    @app.get("/links", tags=["links"], summary="Where links are opened, and the statistics of each link")
    async def links() -> dict[str, Any]:
        told = backend.statistics()
        places = [{"place": number, "address": address} for number, address in backend.places()]
        return {"places": places, "links": [*told["autopilot_links"], *told["clients"]]}

    @app.post(
        "/links",
        status_code=201,
        tags=["links"],
        summary="Open links at a place",
        description="To clients, as the options of lostlink aps do; without a token only on this machine.",
        responses={
            403: {"description": "It leads beyond this machine, and the API has no token"},
            409: {"description": "The port is taken, or too much is open"},
        },
    )
    async def open_links(new: NewLinks) -> dict[str, Any]:
        try:
            if not has_token:
                _check_local(new.address)
            if sum(number is not None for number, _ in backend.places()) >= MAX_OPENED:
                raise HTTPException(409, f"{MAX_OPENED} places are open already")
            return {"place": await backend.open_links(new.address), "address": new.address}
        except ValueError as error:
            raise HTTPException(422, str(error)) from error
        except OSError as error:
            raise HTTPException(409, error.strerror or str(error)) from error

    @app.delete(
        "/links/{place}",
        status_code=204,
        tags=["links"],
        summary="End the links of a place that was opened over the API",
        responses={404: {"description": "There is no such place"}},
    )
    async def shut_links(place: int) -> Response:
        if not await backend.shut_links(place):
            raise HTTPException(404, f"nothing was opened as place {place}")
        return Response(status_code=204)


def _check_local(text: str) -> None:
    """Refuse what leads beyond this machine, or reads a file of it.

    Raises:
        HTTPException: it does.
        ValueError: the address cannot be read.
    """
    place, *rules = text.split(",")
    address = parse_address(place)
    if not is_loopback(address.host) or any(rule.startswith("key=") for rule in rules):
        raise HTTPException(
            403,
            f"{text!r} leads beyond this machine, or names a key: an API without a token opens links on loopback only",
        )
