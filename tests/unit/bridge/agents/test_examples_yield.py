"""Examples that fly to places let go when somebody else gives a target."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bridge.agents import Agent, CommandInterrupted
from bridge.agents.own import load_class
from bridge.scenario.agents import OwnAgent

EXAMPLES = Path(__file__).parents[4] / "examples"
OPTIONS = {"altitude_m": 20.0, "distance_m": 100.0, "speed_mps": 5.0, "silence_s": 1.0}
WANDERS = {"legs": 3, "radius_m": 50.0, "leg_s": 20.0}


class Aircraft:
    """One whose targets are given up, beside an operator who lands it."""

    sim_time_ns = 0

    def __init__(self, error: Exception | None) -> None:
        self.error, self.landed = error, asyncio.Event()
        self.targets, self.said = [], []  # type: list[tuple[float, ...]], list[str]

    async def goto(self, *place: float, speed_mps: float) -> bool:
        self.targets.append((*place, speed_mps))
        if self.error is not None:
            raise self.error
        return False

    async def wait_for(self, condition: Any) -> None:
        if not condition(SimpleNamespace(armed=True)) and condition(SimpleNamespace(armed=False)):
            await self.landed.wait()
        else:
            await asyncio.Event().wait()

    def report(self, text: str) -> None:
        self.said.append(text)

    def transmit(self, *_: Any) -> None:
        pass


async def take_off(_height_m: float) -> SimpleNamespace:
    return SimpleNamespace(latitude_deg=47.0, longitude_deg=8.0, altitude_amsl_m=500.0)


async def sleep(duration_s: float) -> None:
    await asyncio.sleep(0 if math.isfinite(duration_s) else duration_s)


async def every(_period_s: float) -> Any:
    await asyncio.Event().wait()
    yield 0.0


@pytest.mark.parametrize(
    ("file", "name", "error"),
    [
        ("agents/turn_back.py", "TurnBack", None),
        ("agents/wander.py", "Wander", None),
        ("agents/wander.py", "Wander", CommandInterrupted("goto interrupted: by rtl")),
        ("ground_nodes/beyond_range.py", "Scout", None),
    ],
)
async def test_it_flies_to_no_further_place_and_is_done_when_the_aircraft_has_landed(
    file: str, name: str, error: Exception | None
) -> None:
    agent: Any = Agent.__new__(load_class(str(EXAMPLES / file), name))
    agent.ua = ua = Aircraft(error)
    own = {"type": "own", "class": f"{file}:{name}", "options": OPTIONS | WANDERS}
    agent.config = SimpleNamespace(agent=OwnAgent.model_validate(own))
    agent.latest, agent.rng = {}, np.random.default_rng(1)
    agent.take_off, agent.sleep, agent.every = take_off, sleep, every
    flying = asyncio.create_task(agent.fly())
    for _ in range(50):
        await asyncio.sleep(0)
    assert not flying.done()
    assert "yields" in ua.said[-1]
    ua.landed.set()
    await flying
    assert len(ua.targets) == 1
