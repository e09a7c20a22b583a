"""The mission as a user flies it, over a weaker radio and not so far: twice with the relay, once without."""

from __future__ import annotations

import numpy as np
import pytest

from lostlink.reading.run import Run
from tests.integration.examples.conftest import FlyMission

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
SHORT = {
    "radio.transmit_power_dbm": 12,
    "nodes.gcs.radio.transmit_power_dbm": 12,
    "nodes.1.agent.options.radios.ua.transmit_power_dbm": 12,
    "nodes.1.agent.options.radios.ground.transmit_power_dbm": 12,
    "nodes.0.agent.options.altitude_m": 20,
    "nodes.0.agent.options.way": "[[330, 0]]",
    "nodes.1.agent.options.altitude_m": 30,
}


def late_reports(run: Run) -> tuple[float, set[str]]:
    """Of the last 100 reports, the share that came to the ground station, and who brought them."""
    sent, came = run.agent_values("sent"), run.agent_values("arrived")
    numbers = sent[sent["node"] == "0"]["value"].to_numpy()[-100:]
    there = came[(came["node"] == "gcs") & came["number"].isin(numbers)]
    return len(there) / len(numbers), set(there["by"])


@pytest.mark.long
@pytest.mark.slow
def test_the_relay_keeps_it_connected_and_it_repeats(fly_mission: FlyMission) -> None:
    first, second = (fly_mission("relay_placement", name, SHORT) for name in ("first", "second"))
    without = fly_mission("relay_placement", "without", SHORT | {"nodes.1.agent.options.relay": "false"})
    assert first.ending == "done"
    assert first.digest == second.digest
    share, ways = late_reports(first)
    share_without, ways_without = late_reports(without)
    assert "1" in ways
    assert ways_without <= {"0"}
    assert share > share_without + 0.3
    plans = first.agent_values("plan")
    assert len(plans) >= 5
    assert plans["age_s"].min() >= 0.05  # a tick old, as it came over the radio
    relay = first.truth[first.truth["node"] == "1"][["position_north_m", "position_east_m"]].to_numpy()
    went_m = float(np.linalg.norm(relay[-1] - relay[0]))
    assert 20.0 < went_m < 165.0  # nearer to the ground station, which hears badly, than half-way
