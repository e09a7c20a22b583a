"""A script's view of a node, over a real Zenoh router and a real socket."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.agents import connect_ua
from bridge.bus.keys import Keys
from bridge.bus.messages import AircraftState, Clock, Header
from bridge.run.access import Access, NoAccess
from tests.integration.bridge.guarded import RUN, Guarded, guarded_router

KEYS = Keys(RUN)


@pytest.fixture
def router(tmp_path: Path) -> Iterator[Guarded]:
    with guarded_router(tmp_path / "secrets") as guarded:
        yield guarded


def access_to(router: Guarded) -> Access:
    return Access(RUN, router.endpoint, router.keyring.credentials("node-1"))


async def test_condition_that_raises_ends_the_wait_with_its_error(router: Guarded) -> None:
    def condition(state: AircraftState) -> bool:
        raise KeyError("somebody's mistake")

    async with connect_ua(RUN, "1", access=access_to(router)) as ua:
        waiting = asyncio.create_task(ua.wait_for(condition))
        while not waiting.done():  # until the subscription is known to the router
            router.session.put(KEYS.state("1"), AircraftState())
            router.session.put(KEYS.clock, Clock(Header.at(0, "")))
            await asyncio.wait({waiting}, timeout=0.05)
        with pytest.raises(KeyError, match="somebody's mistake"):
            await asyncio.wait_for(waiting, 10.0)
        assert (await asyncio.wait_for(ua.wait_for(lambda state: not state.armed), 10.0)).armed is False


async def test_a_script_beside_the_agent_is_told_that_it_cannot_transmit(router: Guarded) -> None:
    async with connect_ua(RUN, "1", access=access_to(router)) as ua:
        with pytest.raises(PermissionError, match="only the agent of node 1 may transmit"):
            ua.transmit("team", b"x")
        assert ua.sent == 0


async def test_a_run_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(NoAccess, match="there is no run nowhere, nor runs/nowhere"):
        async with connect_ua("nowhere", "1"):
            pass
    with pytest.raises(NoAccess, match="is no run"):
        async with connect_ua(tmp_path, "1"):
            pass
