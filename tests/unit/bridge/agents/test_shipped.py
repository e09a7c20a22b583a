"""Agents that ship let go when somebody else flies."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest

from bridge.agents.commands import CommandInterrupted
from bridge.agents.shipped.yielding import Yielding


class Interrupted(Yielding):
    """Whose command was interrupted."""

    async def mission(self) -> None:
        raise CommandInterrupted("goto interrupted: by rtl")


def agent_of(*, armed: bool, landed: asyncio.Event, said: list[str]) -> Yielding:
    async def wait_for(condition: Any) -> None:
        assert condition(SimpleNamespace(armed=False))
        assert not condition(SimpleNamespace(armed=True))
        await landed.wait()

    agent = Interrupted.__new__(Interrupted)
    agent.ua = SimpleNamespace(state=SimpleNamespace(armed=armed), report=said.append, wait_for=wait_for)  # type: ignore[assignment]
    return agent


async def test_it_is_done_when_whoever_took_over_has_landed() -> None:
    landed, said = asyncio.Event(), []  # type: asyncio.Event, list[str]
    flying = asyncio.create_task(agent_of(armed=True, landed=landed, said=said).fly())
    await asyncio.sleep(0)
    assert said == ["yields: goto interrupted: by rtl"]
    assert not flying.done()
    landed.set()
    await flying


async def test_a_ua_that_is_disarmed_in_flight_is_a_failure() -> None:
    with pytest.raises(CommandInterrupted):
        await agent_of(armed=False, landed=asyncio.Event(), said=[]).fly()
