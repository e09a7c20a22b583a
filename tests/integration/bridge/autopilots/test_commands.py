"""What becomes of an agent's commands in a run: before its autopilot has been heard, and after it has crashed."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from lostlink import fly

AGENT = """\
import asyncio
from lostlink import Agent, CommandFailed

FENCE = [
    {"command": "NAV_FENCE_POLYGON_VERTEX_INCLUSION", "params": [3, 0, 0, 0, 40.13 + north, -105.24 + east, 0]}
    for north, east in ((-0.1, -0.1), (0.1, -0.1), (0.0, 0.1))
]

class Felled(Agent):
    async def fly(self):
        await self.ua.missions.upload(FENCE, "fence")
        await self.ua.parameters.set("RTL_ALT", 2000)
        self.record("set", value=await self.ua.parameters.get("RTL_ALT"))
        await self.take_off(5.0)
        await self.ua.disarm(force=True)
        await self.ua.wait_for(lambda state: not state.armed)
        await self.sleep(1.2)
        async for now_s in self.every(0.2):
            if now_s > 25.0:
                break
            self.steering = asyncio.create_task(self.steer())

    async def steer(self):
        begun_s = self.ua.sim_time_ns / 1e9
        try:
            told = str(await self.ua.velocity(1.0, 0.0))
        except CommandFailed as error:
            told = str(error)
        self.record("steered", told=told, took_s=self.ua.sim_time_ns / 1e9 - begun_s)
"""
SCENARIO = """\
schema: 1
name: commands
duration_s: 40
origin: {{lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690.0}}
radio: perfect
figure: false
ports: {{first_slot: {slot}}}
nodes: [{{id: 0, agent: {{type: own, class: felled.py:Felled}}}}]
"""


@pytest.mark.slow
def test_an_agents_first_commands_wait_for_its_autopilot_and_those_after_a_crash_fail_at_once(
    tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    (tmp_path / "felled.py").write_text(AGENT)
    file = tmp_path / "commands.yaml"
    file.write_text(SCENARIO.format(slot=free_slot(1)))
    digests = set()
    for processes in ("one", "many"):
        result = fly(str(file), changes={"processes": processes}, directory=tmp_path / processes)
        assert (result.ending, result.error) == ("done", None)
        own = result.path / "agents" / "0"
        assert json.loads((own / "set.jsonl").read_text())["value"] == 2000.0
        steered = [json.loads(line) for line in (own / "steered.jsonl").read_text().splitlines()]
        assert len(steered) > 30
        assert {row["told"] for row in steered} == {
            "UA 0: velocity: velocity interrupted: the UA is not armed"
        }
        assert max(row["took_s"] for row in steered) < 0.1
        digests.add(result.summary["digest"])
    assert len(digests) == 1
