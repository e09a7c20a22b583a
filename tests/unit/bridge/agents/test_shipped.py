"""Agents that ship let go when somebody else flies."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest

from bridge.agents.commands import CommandInterrupted
from bridge.agents.shipped.out_and_back import OutAndBack
from bridge.agents.shipped.yielding import Yielding
from bridge.scenario.agents import OutAndBackAgent


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


async def test_it_flies_no_further_leg_when_somebody_gives_another_target() -> None:
    landed, said, legs = asyncio.Event(), [], []  # type: asyncio.Event, list[str], list[tuple[float, ...]]

    async def take_off(_height_m: float) -> SimpleNamespace:
        return SimpleNamespace(latitude_deg=47.0, longitude_deg=8.0, altitude_amsl_m=500.0)

    async def goto(*place: float, speed_mps: float) -> bool:
        legs.append(place)
        return False

    agent = OutAndBack.__new__(OutAndBack)
    config = OutAndBackAgent(type="out_and_back", altitude_m=20.0, distance_m=100.0)
    agent.config = SimpleNamespace(agent=config)  # type: ignore[assignment]
    agent.take_off = take_off  # type: ignore[method-assign, assignment]
    agent.ua = SimpleNamespace(report=said.append, goto=goto, wait_for=lambda _: landed.wait())  # type: ignore[assignment]
    flying = asyncio.create_task(agent.fly())
    for _ in range(3):
        await asyncio.sleep(0)
    assert said == ["flies out at 10 m/s", "yields: another target took the place of its own"]
    assert not flying.done()
    landed.set()
    await flying
    assert len(legs) == 1


async def test_a_ua_that_is_disarmed_in_flight_is_a_failure() -> None:
    with pytest.raises(CommandInterrupted):
        await agent_of(armed=False, landed=asyncio.Event(), said=[]).fly()
