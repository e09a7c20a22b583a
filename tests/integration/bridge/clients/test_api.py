"""The API in a run: what comes over it takes effect at a tick, is recorded, and can be flown again."""

from __future__ import annotations

import http.client
import json
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import pytest

from tests.integration.bridge.conftest import STILL, Run, StartRun
from tests.warm import run_lostlink


def call(run: Run, method: str, path: str, body: object = None) -> tuple[int, Any]:
    """An HTTP request to UA 0."""
    with closing(http.client.HTTPConnection("127.0.0.1", 8760 + 10 * run.slot, timeout=60)) as connection:
        data = None if body is None else json.dumps(body)
        connection.request(method, path, data, {"Content-Type": "application/json"})
        reply = connection.getresponse()
        return reply.status, json.loads(reply.read())


@pytest.mark.long
@pytest.mark.slow
def test_what_comes_over_the_api_is_an_input_that_can_be_flown_again(
    start_run: StartRun, tmp_path: Path
) -> None:
    run = start_run("--api", "--speed", "2", duration_s=40.0)
    run.wait_for("waits for the autopilots")
    state: dict[str, Any] = {}
    while not state.get("ready_to_arm"):
        assert run.process.poll() is None
        with suppress(ConnectionRefusedError):
            state = call(run, "GET", "/state")[1]
    for verb, arguments in (("mode", {"mode": "GUIDED"}), ("arm", {}), ("takeoff", {"alt_rel_m": 3.0})):
        status, result = call(run, "POST", f"/commands/{verb}", arguments)
        assert (status, result["outcome"]) == (200, "reached"), result
    assert call(run, "GET", "/messages/ATTITUDE")[0] == 200
    assert call(run, "POST", "/commands/goto", {"lat_deg": 100, "lon_deg": 0, "alt_rel_m": 1})[0] == 422
    assert run.finish() == 0, run.output.decode()
    inputs = [json.loads(line) for line in (run.directory / "inputs" / "0.jsonl").read_text().splitlines()]
    assert [item["verb"] for item in inputs] == ["mode", "arm", "takeoff"]
    assert inputs[2]["arguments"] == {"alt_rel_m": 3.0}
    assert run.summary["may_not_repeat"] == []
    command = ["refly", str(run.directory), "--out", str(tmp_path / "again"), "--speed", "max"]
    again = run_lostlink(*command, timeout=280)
    assert again.returncode == 0, again.stdout + again.stderr


FLYER = """\
from bridge.agents import Agent, CommandRefused

class Flyer(Agent):
    async def fly(self):
        await self.take_off(3.0)
        ua, keep = self.ua, self.record
        keep("flight", reached=await ua.velocity(2.0, 0.0, -0.5, duration_s=3.0))
        keep("flight", reached=await ua.goto_ned(0.0, 5.0, -5.0))
        attitude = await ua.message("ATTITUDE")
        keep("flight", roll=attitude["roll"])
        items = [{"command": 16, "params": [0, 0, 0, 0, ua.state.latitude_deg + n * 1e-4, ua.state.longitude_deg, 5]}
                 for n in (1, 2)]
        keep("flight", taken=await ua.missions.upload(items))
        keep("flight", items=await ua.missions.download())
        try:
            await ua.missions.upload([{"command": 16}])
        except CommandRefused as error:
            keep("flight", refused=str(error))
        await ua.mission(items)
        keep("flight", parameters=len(await ua.parameters.all()))
        await ua.land()
"""


@pytest.mark.slow
def test_an_agents_commands_of_every_kind_repeat(start_run: StartRun, tmp_path: Path) -> None:
    (tmp_path / "flyer.py").write_text(FLYER)
    own = f"{{{{type: own, class: {tmp_path}/flyer.py:Flyer}}}}"
    first, rest = STILL.split("{{type: still}}", 1)
    runs = [start_run(*more, scenario=first + own + rest, duration_s=200.0) for more in ((), ("--api",))]
    kept = []
    for run in runs:
        assert run.finish() == 0, run.output.decode()
        kept.append((run.directory / "agents" / "0" / "flight.jsonl").read_text())
    assert runs[0].summary["digests"] == runs[1].summary["digests"]
    assert kept[0] == kept[1]
    rows = [json.loads(line) for line in kept[0].splitlines()]
    assert rows[0]["reached"] is rows[1]["reached"] is True
    assert rows[3]["taken"] == 2
    assert [item["command"] for item in rows[4]["items"]] == [16, 16]
    assert "has 'command' and 'params'" in rows[5]["refused"]
    assert rows[6]["parameters"] > 5
