"""A motor failure, from scenario to record: the stand-in's copter drops from 15 m and stays where it fell."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from bridge.record.tables.truth import TRUTH, VELOCITY
from fdm.model.airframe import AIRFRAMES_DIR
from tests.integration.bridge.conftest import STILL, StartRun

GRAVITY = 9.81
HEIGHT_M = 15.0
FELLED = """
from bridge.agents import Agent

class Felled(Agent):
    async def fly(self):
        await self.take_off(15.0)
        await self.ua.disarm(force=True)
        await self.sleep_until(self.ua.sim_time_ns / 1e9 + 12.0)
"""


@pytest.mark.parametrize("airframe", ["f450", pytest.param("hexa550", marks=pytest.mark.slow)])
@pytest.mark.slow
def test_a_copter_that_is_disarmed_at_15_m_comes_to_rest(
    start_run: StartRun, tmp_path: Path, airframe: str
) -> None:
    (tmp_path / "felled.py").write_text(FELLED)
    own = f"airframe: {airframe}, agent: {{{{type: own, class: {tmp_path}/felled.py:Felled}}}}"
    run = start_run(scenario=STILL.replace("agent: {{type: still}}", own, 1), duration_s=40.0)
    assert run.finish() == 0, run.output.decode()
    rows = pq.read_table(TRUTH.parquet_path(run.directory)).to_pylist()
    rows = [row for row in rows if row["node"] == "0"]
    heights = [-row["position_down_m"] for row in rows]
    speeds = [math.hypot(*(row[name] for name in VELOCITY)) for row in rows]
    top = max(range(len(heights)), key=heights.__getitem__)
    assert heights[top] == pytest.approx(HEIGHT_M, abs=1.0)
    # It falls at g, less the drag, from the height it had: sqrt(2 g h) = 17 m/s at most.
    fastest = max(speeds[top:])
    assert 14.0 < fastest < math.sqrt(2 * GRAVITY * heights[top])
    ground = next(i for i in range(top, len(heights)) if heights[i] < 1.0)
    assert max(heights[ground:]) < HEIGHT_M / 2
    assert min(heights) > -0.4
    assert speeds[-1] < 0.05
    assert heights[-1] < 0.5
    assert "let go" not in run.output.decode()
    [warning] = run.summary["warnings"]
    hit = re.fullmatch(r"hit the ground: UA 0 at ([0-9.]+) m/s, at [0-9.]+ s: .*", warning)
    assert hit, warning
    assert float(hit[1]) == pytest.approx(fastest, abs=0.6)


def test_a_ua_that_hit_the_ground_is_told_of(start_run: StartRun, tmp_path: Path) -> None:
    """It begins 5 m up, its motors off: sqrt(2 g h) is 9.9 m/s, and a tick earlier up to 0.5 m/s less."""
    airframe = (AIRFRAMES_DIR / "f450.yaml").read_text(encoding="utf-8")
    for old, new in (
        ("root: jsbsim", f"root: {AIRFRAMES_DIR / 'jsbsim'}"),
        ("height_above_ground_m: 0.1524", "height_above_ground_m: 5.0"),
        ("settle_s: 3.0", "settle_s: 0.0"),
    ):
        assert old in airframe
        airframe = airframe.replace(old, new)
    (tmp_path / "high.yaml").write_text(airframe, encoding="utf-8")
    own = f"airframe: {tmp_path}/high.yaml, agent: {{{{type: still}}}}"
    run = start_run(scenario=STILL.replace("agent: {{type: still}}", own, 1), duration_s=3.0)
    assert run.finish() == 0, run.output.decode()
    [warning] = run.summary["warnings"]
    hit = re.fullmatch(r"hit the ground: UA 0 at ([0-9.]+) m/s, at 1[0-9.]* s: .*", warning)
    assert hit, warning
    assert 9.0 < float(hit[1]) < 9.9
