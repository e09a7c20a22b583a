"""The mission as a user flies it, twice: the average that the UA meet at is that of their places, by the record."""

from __future__ import annotations

import numpy as np
import pytest

from tests.integration.examples.conftest import FlyMission

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
SHORT = {
    "nodes.0.count": 3,
    "nodes.0.home.random": "{north_m: [0, 150], east_m: [0, 150], min_spacing_m: 60}",
    **{f"nodes.{node}.agent.options.altitude_m": 10 + 5 * node for node in range(3)},
    "nodes.*.agent.options.agree_s": 14,
    "nodes.*.agent.options.leave_s": 23,
}


def test_they_meet_at_the_average_of_their_places_and_it_repeats(fly_mission: FlyMission) -> None:
    first, second = (fly_mission("consensus", name, SHORT) for name in ("first", "second"))
    assert first.ending == "done"
    assert first.digest == second.digest
    assert first.links["delivered"].sum() < 0.9 * first.links["sent"].sum()
    truth = first.truth[first.truth["node"].isin(["0", "1", "2"])]
    axes = ["position_north_m", "position_east_m"]
    begin, end = (truth[truth["tick_ns"] == at][axes].to_numpy() for at in (0, truth["tick_ns"].max()))
    assert begin.shape == end.shape == (3, 2)
    told = first.agent_values("estimate").groupby("node")["value"].last()
    assert set(told.index) == {"0", "1", "2"}
    for estimate in told:
        assert estimate == pytest.approx(begin.mean(axis=0), abs=1.0)  # it hovers within a metre of home
    assert end.mean(axis=0) == pytest.approx(
        begin.mean(axis=0), abs=2.0
    )  # a ring has its middle in the middle
    assert np.linalg.norm(end - end.mean(axis=0), axis=1) == pytest.approx(25.0, abs=2.0)
