"""An agent that flies by the fleet's frame is where it says, measures where it is, and takes off when all do."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from lostlink import fly

AGENT = """\
import math
from lostlink import Agent

class Seeker(Agent):
    async def fly(self):
        self.begun = self.ua.state is not None
        await self.take_off(10.0)
        await self.ua.goto_ned(212.0, -90.0, -10.0, frame="fleet", within_m=0.5)
        await self.ua.hold()
        await self.sleep(0.2)
        place = self.ua.place_ned_m
        self.record("end", begun=self.begun, place=place, latest=len(self.latest))

    def on_tick(self, sim_time_ns):
        if self.ua.state is not None:
            self.log("finite", math.isfinite(sum(self.ua.state.position_ned_m.xyz)))

    def on_measurement(self, measurement):
        if measurement.place_ned_m is not None:
            self.record("measured", at_ns=measurement.sim_time_ns, place=measurement.place_ned_m)
"""
SCENARIO = """\
schema: 1
name: frames
duration_s: 60
take_off_at_s: 8
origin: {{lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690.0}}
radio: perfect
figure: false
ports: {{first_slot: {slot}}}
nodes:
  - id: 0
    home: {{north_m: 200, east_m: -100}}
    sensor: {{rate_hz: 4}}
    agent: {{type: own, class: {agent}:Seeker}}
  - {{id: gcs, kind: ground, agent: {{type: still}}}}
  - {{id: beacon, kind: emitter, place: {{north_m: 300}}, frequency_hz: 433.92e+6, power_dbm: 20}}
"""


@pytest.mark.slow
def test_places_are_those_of_the_truth_and_take_off_is_when_the_scenario_says(
    tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    agent = tmp_path / "seeker.py"
    agent.write_text(AGENT)
    file = tmp_path / "frames.yaml"
    file.write_text(SCENARIO.format(slot=free_slot(1), agent=agent))
    result = fly(str(file), directory=tmp_path)
    assert (result.ending, result.error) == ("done", None)
    truth = result.run.truth
    truth = truth[truth.node == "0"].set_index("tick_ns")
    places = truth[["position_north_m", "position_east_m", "position_down_m"]]
    (end,) = map(json.loads, (result.path / "agents" / "0" / "end.jsonl").read_text().splitlines())
    assert end["place"] == pytest.approx([212.0, -90.0, -10.0], abs=1.0)
    assert end["place"] == pytest.approx(places.iloc[-1].to_list(), abs=0.5)
    assert (end["begun"], end["latest"]) == (False, 1)
    rows = [
        json.loads(line)
        for line in (result.path / "agents" / "0" / "measured.jsonl").read_text().splitlines()
    ]
    assert len(rows) > 30
    for row in rows:
        assert row["place"] == pytest.approx(places.loc[row["at_ns"]].to_list(), abs=1.0)
    left_s = (places.position_down_m < places.position_down_m.iloc[0] - 0.3).idxmax() / 1e9
    assert 8.0 < left_s < 11.0
