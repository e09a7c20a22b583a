"""What cannot be decided anew is refused: it would be in the new scenario, and in nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from bridge.scenario.file import with_changes
from bridge.scenario.model import Scenario
from lostlink.redecision.as_flown import refuse_another_flight
from lostlink.redecision.redecide import decide
from tests.unit.lostlink.replay.flown import flown, scenario_of


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return scenario_of("moon2020", ("0", "1", "gcs"), emitters=("b1",))


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        ("duration_s", 5, "duration_s"),
        ("tick_rate_hz", 10, "tick_rate_hz"),
        ("transmit.every_ticks", 5, "transmit"),
        ("wind.speed_mps", 3, "wind"),
        ("origin.lat_deg", 41, "origin"),
        ("nodes.1.home.north_m", 5000, "nodes.1.home"),
        ("nodes.1.airframe", "hexa550", "nodes.1.airframe"),
        ("nodes.0.sensor", {"rate_hz": 1}, "nodes.0.sensor"),
        ("nodes.gcs.place", {"north_m": 9}, "nodes.gcs.place"),
        ("nodes.b1.place", {"north_m": 9}, "nodes.b1.place"),
    ],
)
def test_another_flight_is_refused_with_its_key(scenario: Scenario, key: str, value: Any, told: str) -> None:
    with pytest.raises(ValueError, match=f"^{told}: runs/A"):
        refuse_another_flight(Path("runs/A"), scenario, with_changes(scenario, {key: value}))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("seed", 5),
        ("radio", "wifi-2.4"),
        ("networks", {"other": {"radio": "disk"}}),
        ("nodes.1.radio_off", [{"from_s": 1, "to_s": 2}]),
        ("partitions", [{"groups": [[0], [1]], "from_s": 1}]),
        ("nodes.b1.power_dbm", 40),
        ("expectations", [{"type": "delivery", "at_least": 0.5}]),
        ("name", "anew"),
    ],
)
def test_another_radio_is_not(scenario: Scenario, key: str, value: Any) -> None:
    refuse_another_flight(Path("runs/A"), scenario, with_changes(scenario, {key: value}))


def test_a_decision_refuses_it(scenario: Scenario, tmp_path: Path) -> None:
    run = flown(tmp_path / "run", scenario, ticks=4)
    with pytest.raises(ValueError, match=r"^nodes\.1\.home: .* stay as recorded"):
        decide(run, with_changes(scenario, {"nodes.1.home.north_m": 100}))
