"""What every study measures of a run."""

from __future__ import annotations

from pathlib import Path

import pytest

from lostlink.reading.positions import places_of, separation_m
from lostlink.reading.run import load_run
from lostlink.report.content import least_separation_m
from lostlink.study.metrics import of_tables
from tests.unit.lostlink.replay.flown import Sent, flown, scenario_of


def test_the_least_separation_is_that_of_ua_as_in_the_report(tmp_path: Path) -> None:
    path = tmp_path / "made"
    flown(path, scenario_of("moon2020", ("0", "gcs", "1")), ticks=20)
    run = load_run(path)
    of_all, _ = separation_m(places_of(path, run.nodes)[1].values())
    assert of_tables(run)["separation_min_m"] == least_separation_m(run) > of_all


def test_each_network_has_numbers_of_its_own(tmp_path: Path) -> None:
    """Both send on `main`, of which all arrives, and UA 0 on another network, of which half does."""
    scenario = scenario_of(
        "perfect", ("0", "1"), extra="networks: {tele: {preset: perfect, base_loss: 0.5}}\n"
    )
    sent = [Sent("0"), Sent("1"), Sent("0", radio="tele")]
    found = of_tables(load_run(flown(tmp_path / "made", scenario, 100, lambda _tick: sent)))
    assert found["main: delivery"] == 1.0
    assert found["tele: delivery"] == found["delivery_tele_0_1"] == pytest.approx(0.5, abs=0.2)
    assert found["delivery"] == pytest.approx((2.0 + found["tele: delivery"]) / 3.0)
    assert found["main: age_mean_s"] == pytest.approx(0.05, abs=0.03)
    assert found["tele: age_mean_s"] > found["main: age_mean_s"] + 0.02
    alone = scenario_of("perfect", ("0", "1"))
    plain = of_tables(load_run(flown(tmp_path / "alone", alone, 5)))
    assert not [name for name in plain if ": " in name]
