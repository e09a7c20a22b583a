"""What every study measures of a run."""

from __future__ import annotations

from pathlib import Path

from lostlink.reading.positions import places_of, separation_m
from lostlink.reading.run import load_run
from lostlink.report.content import least_separation_m
from lostlink.study.metrics import of_tables
from tests.unit.lostlink.replay.flown import flown, scenario_of


def test_the_least_separation_is_that_of_ua_as_in_the_report(tmp_path: Path) -> None:
    path = tmp_path / "made"
    flown(path, scenario_of("moon2020", ("0", "gcs", "1")), ticks=20)
    run = load_run(path)
    of_all, _ = separation_m(places_of(path, run.nodes)[1].values())
    assert of_tables(run)["separation_min_m"] == least_separation_m(run) > of_all
