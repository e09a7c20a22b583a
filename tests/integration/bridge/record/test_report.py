"""Reports on real runs: numbers as in summary.json, also of a run that was killed."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from lostlink import fly, load_run
from lostlink.report.tracks import tracks_of
from tests.integration.bridge.conftest import STILL, StartRun
from tests.warm import run_lostlink

LOSING = {
    "radio": {"preset": "moon2020", "base_loss": 0.2},
    "expectations": [
        {"type": "delivery", "at_least": 0.99, "name": "hears nearly all"},
        {"type": "age", "node": 1, "at_most_s": 3.0},
    ],
}


def report_of(path: Path) -> dict[str, Any]:
    done = run_lostlink("report", str(path), "--json", check=True)
    content: dict[str, Any] = json.loads(done.stdout)
    return content


@pytest.mark.slow
def test_a_report_has_the_numbers_of_the_summary(tmp_path: Path, free_slot: Callable[[int], int]) -> None:
    scenario = yaml.safe_load(STILL.format(speed="max", duration_s=5.0, slot=free_slot(2))) | LOSING
    result = fly(scenario, directory=tmp_path)
    summary, content = result.summary, report_of(result.path)
    counts = ("tx", "rx", "sent", "delivered", "lost")
    assert [{key: link[key] for key in counts} for link in content["links"]] == [
        {key: link[key] for key in counts} for link in summary["links"]
    ]
    for key in ("bins", "checks", "expectations", "events", "may_not_repeat"):
        assert content[key] == summary[key], key
    for key in ("scenario", "seed", "ending", "verdict", "digest", "sim_duration_s", "wall_duration_s"):
        assert content["run"][key] == summary[key], key
    assert [e["passed"] for e in content["expectations"]] == [False, True]
    assert content["provenance"]["lostlink"]
    assert content["separation_min_m"] == pytest.approx(410.0, abs=0.5)
    ages = load_run(result.path).ages
    assert [link["age_peak_s"] for link in content["links"]] == ages.peak_s.tolist()
    assert 0.1 <= ages.peak_s.max() <= 3.1
    assert load_run(result.path).latencies.max_s.tolist() == [0.05, 0.05]


@pytest.mark.slow
def test_a_killed_run_has_a_report(start_run: StartRun) -> None:
    run = start_run(speed="1")
    run.wait_for("sim time")
    path = run.directory
    until_s = time.monotonic() + 60.0
    # Journals are flushed once a second, each by itself: that packets can be read says nothing of the true states.
    while not (
        load_run(path).columns("deliveries", ["seq"])["seq"].size
        and len(tracks_of(load_run(path))["nodes"]) == 2
    ):
        assert run.process.poll() is None
        assert time.monotonic() < until_s, "nothing was recorded"
        time.sleep(0.1)
    run.stop(signal.SIGKILL)
    content = report_of(path)
    assert (content["run"]["ending"], content["run"]["verdict"]) == ("killed", "")
    assert content["totals"]["sent"] == sum(link["sent"] for link in content["links"]) > 0
    assert content["nodes"][1]["farthest_m"] == pytest.approx(410.0, abs=0.5)
