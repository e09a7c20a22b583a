"""A case's process: what it says of a run that is there already."""

from __future__ import annotations

import fcntl
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from bridge.run.directory import SUMMARY_FILE, RunDirectory
from lostlink.study.case_process import (
    LOCK_FILE,
    RESULT_FILE,
    RUN_FOLDER,
    CasePlan,
    fly_case,
    forget,
    read_result,
    recorded,
    write_whole,
)
from lostlink.study.model import Function
from tests.unit.lostlink.replay.flown import flown, scenario_of

SUMMARY = {
    "ending": "failed",
    "error": "the radio ended with status 1",
    "outcome": "broke_off",
    "verdict": "",
    "digest": "",
    "expectations": [],
    "sim_duration_s": 0.0,
}
TIMING = {"wall_duration_s": 1.0, "real_time_factor": 0.0}


def test_a_run_that_failed_without_tables_says_why(tmp_path: Path) -> None:
    scenario = scenario_of("moon2020", ("0", "1"))
    run = RunDirectory.create(tmp_path, scenario.name)
    run.write(scenario, "tcp/127.0.0.1:1")
    (run.path / SUMMARY_FILE).write_text(json.dumps(SUMMARY), encoding="utf-8")
    (tmp_path / RUN_FOLDER).symlink_to(run.path.name)
    CasePlan(scenario.to_yaml(), (), "all").write(tmp_path)
    assert fly_case(tmp_path) == 1
    result = read_result(tmp_path)
    assert result is not None
    assert result["failure"] == SUMMARY["error"]
    assert (result["metrics"]["ending"], result["metrics"]["passed"]) == ("failed", False)
    assert result["run"] == run.path.name


def test_of_a_failed_run_that_is_not_kept_the_logs_stay(tmp_path: Path) -> None:
    """What says why it failed names them."""
    scenario = scenario_of("moon2020", ("0", "1"))
    run = RunDirectory.create(tmp_path, scenario.name)
    run.write(scenario, "tcp/127.0.0.1:1")
    run.log_path("node-0").write_text("ValueError\n", encoding="utf-8")
    (run.path / SUMMARY_FILE).write_text(json.dumps(SUMMARY), encoding="utf-8")
    (tmp_path / RUN_FOLDER).symlink_to(run.path.name)
    CasePlan(scenario.to_yaml(), (), "none").write(tmp_path)
    assert fly_case(tmp_path) == 1
    assert [path.name for path in run.path.rglob("*")] == ["logs", "node-0.log"]
    assert not (tmp_path / RUN_FOLDER).is_symlink()


def test_a_copy_in_the_place_of_the_link_is_the_run(tmp_path: Path) -> None:
    """Archives may follow links."""
    assert recorded(tmp_path) is None
    (tmp_path / RUN_FOLDER).mkdir()
    assert recorded(tmp_path) == tmp_path / RUN_FOLDER


def test_a_metric_called_as_what_varies_is_refused(tmp_path: Path) -> None:
    """Of a run that was measured before it varied, too: else it stood in the table in the place of the setting."""
    run = flown(tmp_path / "flown", scenario_of("perfect", ("0", "1")), 5)
    (run / SUMMARY_FILE).write_text(
        json.dumps(SUMMARY | {"ending": "done", "error": None} | TIMING), encoding="utf-8"
    )
    (tmp_path / RUN_FOLDER).symlink_to(run.name)
    (tmp_path / "own.py").write_text('def measure(run):\n    return {"radio": 3}\n', encoding="utf-8")
    plan = CasePlan("", (Function(place=str(tmp_path / "own.py"), name="measure"),), "all")
    plan.write(tmp_path)
    assert fly_case(tmp_path) == 0
    replace(plan, labels={"radio": "perfect", "seed": 1}).write(tmp_path)
    assert fly_case(tmp_path) == 1
    result = read_result(tmp_path)
    assert result is not None
    wrong = "own.py:measure: radio: is a column of the study's own: give it another name"
    assert result["failure"] == wrong  # without the place of the study's folder, on which no row hangs
    assert "radio" not in result["metrics"]


def test_a_result_is_forgotten_unless_it_is_done_or_in_hand(tmp_path: Path) -> None:
    """Another study may have flown the case since this one looked, or be at it."""
    labels = {"seed": 1}
    content = {"failure": "", "measures": "a", "metrics": {}, "timing": {}}
    write_whole(tmp_path / RESULT_FILE, content)
    forget(tmp_path, "a", labels)
    assert read_result(tmp_path) == content
    with (tmp_path / LOCK_FILE).open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        forget(tmp_path, "b", labels)
    assert read_result(tmp_path) == content
    forget(tmp_path, "b", labels)
    assert read_result(tmp_path) is None
    forget(tmp_path, "b", labels)


@pytest.mark.slow
def test_two_studies_at_once_write_a_plan_each_as_a_whole(tmp_path: Path) -> None:
    code = (
        "import sys\nfrom pathlib import Path\nfrom lostlink.study.case_process import write_whole\n"
        "for _ in range(1000):\n    write_whole(Path(sys.argv[1]), sys.argv[2] * 5000)\n"
    )
    file = tmp_path / "plan.json"
    writers = [subprocess.Popen([sys.executable, "-c", code, str(file), text]) for text in "ab"]
    assert [writer.wait(60.0) for writer in writers] == [0, 0]
    assert set(json.loads(file.read_text(encoding="utf-8"))) in ({"a"}, {"b"})
    assert list(tmp_path.iterdir()) == [file]
