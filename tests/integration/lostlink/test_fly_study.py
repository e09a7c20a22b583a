"""Studies from Python: `fly_study` with real runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from lostlink import LocalLanes, StudyError, fly_study
from lostlink.study.study import Standing

FOUND = "def found(run):\n    return {'ticks': run.truth.sim_time_ns.nunique()}\n"
SHORT = {"duration_s": np.float64(1.0), "mcap.write": False, "processes": "one"}


def study(folder: Path, *seeds: int, **more: Any) -> dict[str, Any]:
    (folder / "own.py").write_text(FOUND, encoding="utf-8")
    return {
        "schema": 1,
        "name": "mine",
        "scenario": "separation",
        "seeds": list(seeds),
        "set": SHORT,
        "metrics": "own.py:found",
        **more,
    }


def workers() -> set[int]:
    return {each.pid for each in psutil.Process().children() if is_worker(each)}


def is_worker(process: psutil.Process) -> bool:
    try:
        return "lostlink.study.case_process" in process.cmdline()
    except psutil.Error:  # one of another test, which has just ended
        return False


def test_runs_of_a_mapping_fly_once_and_in_processes_that_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Files are seen from the working directory, the second study has a run of the first."""
    monkeypatch.chdir(tmp_path)
    told: list[Standing] = []
    with LocalLanes(1) as lanes:
        one = fly_study(study(tmp_path, 1), lanes=lanes)
        worker = workers()
        two = fly_study(study(tmp_path, 1, 2), lanes=lanes, tell=told.append)
        assert workers() == worker
        assert len(worker) == 1
    assert not workers()
    assert (one.failed, two.failed) == (0, 0)
    assert one.table.ticks.tolist() == [21]
    assert two.table.seed.tolist() == [1, 2]
    assert two.rows[0] == one.rows[0]
    assert [standing.flown for standing in told if standing.case] == [1]
    assert two.path == tmp_path / "studies" / "mine"
    assert (two.path / "metrics.parquet").is_file()


def test_a_run_that_fails_and_a_figure_that_is_not_drawn_are_told(tmp_path: Path) -> None:
    own = tmp_path / "own.py"
    content = study(tmp_path, 1, metrics=f"{own}:found", figures=f"{own}:figure")
    own.write_text("def found(run): 1 / 0\ndef figure(table, folder): 1 / 0\n", encoding="utf-8")
    result = fly_study(content, directory=tmp_path, lanes=1)
    assert (result.failed, len(result.not_drawn)) == (1, 1)
    assert "ZeroDivisionError" in result.table.failure[0]
    assert "figure: ZeroDivisionError" in result.not_drawn[0]
    assert repr(result) == "<StudyResult mine: 1 runs, 1 failed>"


def test_mistakes_name_their_keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(StudyError, match=r"^study: seedz: unknown key; did you mean seeds\?"):
        fly_study(study(tmp_path, 1) | {"seedz": 1}, directory=tmp_path)
    with pytest.raises(StudyError, match=r"^study: metrics: has to be FILE\.py:FUNCTION"):
        fly_study(study(tmp_path, 1, metrics=7), directory=tmp_path)
    with pytest.raises(StudyError, match=r"nowhere\.yaml: cannot be read"):
        fly_study(tmp_path / "nowhere.yaml")
    no_studies: tuple[Any, ...] = ([], None, b"study.yaml")
    for no_study in no_studies:
        with pytest.raises(StudyError, match=r"has to be its file, or the content of one as a mapping \(got"):
            fly_study(no_study)
