"""A script's view of a node, over a real Zenoh router and a real socket."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

import pytest

from bridge.agents import connect_ua
from bridge.bus.keys import Keys
from bridge.bus.messages import AircraftState
from bridge.bus.session import Session, free_port, open_router

KEYS = Keys("r")


@pytest.fixture
def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def router(endpoint: str) -> Iterator[Session]:
    with open_router(endpoint) as session:
        yield session


async def test_condition_that_raises_ends_the_wait_with_its_error(router: Session, endpoint: str) -> None:
    def condition(state: AircraftState) -> bool:
        raise KeyError("somebody's mistake")

    async with connect_ua(endpoint, run="r", node="1") as ua:
        waiting = asyncio.create_task(ua.wait_for(condition))
        while not waiting.done():  # until the subscription is known to the router
            router.put(KEYS.state("1"), AircraftState())
            await asyncio.wait({waiting}, timeout=0.05)
        with pytest.raises(KeyError, match="somebody's mistake"):
            await asyncio.wait_for(waiting, 10.0)
        assert (await asyncio.wait_for(ua.wait_for(lambda state: not state.armed), 10.0)).armed is False


async def test_a_script_beside_the_agent_is_told_that_it_cannot_transmit(
    router: Session, endpoint: str
) -> None:
    async with connect_ua(endpoint, run="r", node="1") as ua:
        with pytest.raises(PermissionError, match="only the agent of node 1 may transmit"):
            ua.transmit("team", b"x")
        assert ua.sent == 0
