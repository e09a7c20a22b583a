"""The supervisor gives a run up when it has to, and tells what became of its processes."""

from __future__ import annotations

import math

import pytest

from bridge.fleet.supervisor import patience_of
from bridge.scenario.file import read_scenario, with_changes
from bridge.timeouts import SILENCE_S


@pytest.mark.parametrize(
    ("changes", "patience_s"),
    [
        ({}, SILENCE_S),
        ({"fdm.stall_timeout_s": 45.0}, SILENCE_S),
        ({"fdm.stall_timeout_s": 300.0}, 600.0),
        ({"fdm.stall_timeout_s": 300.0, "autopilot": "external"}, math.inf),
    ],
)
def test_time_may_stand_still_for_longer_than_an_autopilot_may_be_silent(
    changes: dict[str, object], patience_s: float
) -> None:
    assert patience_of(with_changes(read_scenario("separation"), changes)) == patience_s
