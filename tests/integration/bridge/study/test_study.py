"""Studies as users fly them: killed, resumed, on a cluster, two at once. All of them have to leave one table."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pyarrow.parquet as pq
import pytest

from tests.warm import run_lostlink

COUNT = int(os.environ.get("LOSTLINK_STUDY_RUNS", "6"))
"""Runs of the study that is killed and resumed; the issue's figure is 40."""
WAIT_S = 60.0 + 30.0 * COUNT
SCENARIO = """
schema: 1
name: near
duration_s: 2
speed: max
origin: {lat_deg: 40.13, lon_deg: -105.24, alt_amsl_m: 1690}
radio: moon2020
nodes:
  - {id: 0, agent: {type: still}}
  - {id: 1, home: {north_m: 380}, agent: {type: still}}
"""
OWN = """
import sys


def measure(run):
    heard = int((run.columns("deliveries", ["rx"])["rx"] == "1").sum())
    return {"heard_by_1": heard, "series": [1, 2], "frames_are_there": "pandas" in sys.modules}


def draw(table, directory):
    (directory / "drawn.txt").write_text(str(len(table)))
"""

pytestmark = [pytest.mark.slow, pytest.mark.timeout(4 * WAIT_S)]


@pytest.fixture
def make_study(tmp_path) -> Callable[..., Path]:
    (tmp_path / "near.yaml").write_text(SCENARIO, encoding="utf-8")
    (tmp_path / "own.py").write_text(OWN, encoding="utf-8")

    def make(name: str = "mine", count: int = COUNT, more: str = "") -> Path:
        file = tmp_path / f"{name}.yaml"
        file.write_text(
            f"schema: 1\nname: {name}\nscenario: near.yaml\nseeds: {{first: 1, count: {count // 2}}}\n"
            f"vary: {{radio: [moon2020, corrected]}}\nmetrics: own.py:measure\nfigures: own.py:draw\n{more}",
            encoding="utf-8",
        )
        return file

    return make


def command(file: Path, out: Path, *options: str) -> list[str]:
    return [sys.executable, "-m", "lostlink", "study", str(file), "--out", str(out), *options]


def fly(file: Path, out: Path, *options: str, lanes: int = 1) -> subprocess.CompletedProcess[str]:
    """Each lane imports everything, which costs as much as some runs of two seconds."""
    return run_lostlink("study", file, "--out", out, "--lanes", str(lanes), *options, timeout=WAIT_S)


def table(out: Path, name: str = "mine") -> list[dict]:
    return pq.read_table(out / name / "metrics.parquet").to_pylist()


def kill_after(process: subprocess.Popen[bytes], out: Path, done: int) -> None:
    """Kill the study when so many runs are over."""
    while process.poll() is None and len(list(out.glob("mine/runs/*/result.json"))) < done:
        time.sleep(0.05)
    children = psutil.Process(process.pid).children(recursive=True)
    process.kill()
    process.wait()
    assert not psutil.wait_procs(children, timeout=20)[1]  # the kernel ends what a killed study has started


@pytest.fixture
def whole(make_study, tmp_path) -> list[dict]:
    """The table of the study that nobody disturbs."""
    flown = fly(make_study(), tmp_path / "whole", lanes=2)
    assert flown.returncode == 0, flown.stderr
    return table(tmp_path / "whole")


@pytest.mark.long
def test_a_study_killed_twice_and_resumed_leaves_the_same_table_as_a_whole_one(make_study, tmp_path, whole):
    file, out = make_study(), tmp_path / "killed"
    for done in (1, COUNT // 2):
        started = subprocess.Popen(command(file, out, "--lanes", "2"), stdout=subprocess.DEVNULL)
        kill_after(started, out, done)
    kept = {path: path.stat().st_mtime_ns for path in out.glob("mine/runs/*/result.json")}
    assert len(kept) >= COUNT // 2
    resumed = fly(file, out)
    assert resumed.returncode == 0, resumed.stderr
    assert {path: path.stat().st_mtime_ns for path in kept} == kept  # nothing was flown again
    assert table(out) == whole
    assert len(whole) == COUNT
    assert len({row["digest"] for row in whole}) == COUNT
    assert (out / "mine" / "drawn.txt").read_text() == str(COUNT)


@pytest.mark.long
def test_a_dask_cluster_leaves_the_same_table(make_study, tmp_path, whole):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address="127.0.0.1:0"
    ) as cluster:
        flown = fly(make_study(), tmp_path / "dask", "--scheduler", cluster.scheduler_address)
    assert flown.returncode == 0, flown.stderr
    assert table(tmp_path / "dask") == whole


def test_a_dask_cluster_without_workers_is_told(make_study, tmp_path):
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=0,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
        ) as cluster,
        subprocess.Popen(
            command(make_study(count=2), tmp_path / "out", "--scheduler", cluster.scheduler_address),
            stdout=subprocess.PIPE,
            text=True,
        ) as process,
    ):
        assert process.stdout is not None
        told = next((line for line in process.stdout if "workers there" in line), "")
        assert told == "workers there: none yet; runs begin when one joins\n"
        cluster.scale(1)
        process.communicate(timeout=WAIT_S)
    assert process.returncode == 0
    assert len(table(tmp_path / "out")) == 2


@pytest.mark.long
def test_two_studies_at_once_do_not_disturb_each_other(make_study, tmp_path):
    files = [make_study("one", 2), make_study("two", 2)]
    together = [
        subprocess.Popen(command(file, tmp_path / "out", "--lanes", "1"), stdout=subprocess.DEVNULL)
        for file in files
    ]
    assert [process.wait(WAIT_S) for process in together] == [0, 0]
    one, two = (table(tmp_path / "out", name) for name in ("one", "two"))
    assert one == two  # the same runs, under other names


def test_ctrl_c_ends_it_in_order_and_what_is_done_stays(make_study, tmp_path):
    process = subprocess.Popen(
        command(make_study(), tmp_path / "out", "--lanes", "1"),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 60.0
    while not list((tmp_path / "out").glob("mine/runs/*/result.json")):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    children = psutil.Process(process.pid).children(recursive=True)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 128 + signal.SIGINT
    assert "start it again to go on" in errors
    assert not psutil.wait_procs(children, timeout=20)[1]
    assert len(list((tmp_path / "out").glob("mine/runs/*/result.json"))) >= 1


@pytest.mark.long
def test_what_is_measured_anew_is_not_flown_anew(make_study, tmp_path):
    file, out = make_study(count=2), tmp_path / "out"
    assert fly(file, out).returncode == 0
    before = {path.resolve() for path in out.glob("mine/runs/*/run")}
    own = file.parent / "own.py"
    own.write_text(OWN.replace('"series": [1, 2]', '"added": 1'), encoding="utf-8")
    again = fly(file, out)
    assert again.returncode == 0
    assert "runs: 2, to fly: 0, to measure again: 2" in again.stdout
    assert {path.resolve() for path in out.glob("mine/runs/*/run")} == before
    assert all(row["added"] == 1 and "series" not in row for row in table(out))


@pytest.mark.long
def test_a_run_that_fails_is_told_and_flown_again(make_study, tmp_path):
    file, out = make_study(count=2), tmp_path / "out"
    own = file.parent / "own.py"
    own.write_text(
        "def measure(run):\n    1 / 0\n\n\ndef draw(table, directory):\n    pass\n", encoding="utf-8"
    )
    failed = fly(file, out)
    assert failed.returncode == 1
    assert "ZeroDivisionError" in failed.stdout
    assert {row["failure"] for row in table(out)} == {"own.py:measure: ZeroDivisionError: division by zero"}
    own.write_text(OWN, encoding="utf-8")
    assert fly(file, out).returncode == 0
    assert {row["failure"] for row in table(out)} == {""}


@pytest.mark.parametrize(("keep", "left"), [("none", 0), ("failed", 0), ("all", 2)])
def test_directories_of_runs_stay_as_asked(make_study, tmp_path, keep, left):
    file, out = make_study(count=2, more=f"keep: {keep}\n"), tmp_path / "out"
    assert fly(file, out).returncode == 0
    assert len(list(out.glob("mine/runs/*/run/summary.json"))) == left
    assert len(list(out.glob("mine/runs/*/run/run.mcap"))) == left
    assert len(table(out)) == 2


def test_runs_that_fail_stay_without_what_only_people_look_at(make_study, tmp_path):
    out = tmp_path / "out"
    unmet = "set: {expectations: [{type: ending, ending: done}]}"
    flown = fly(make_study(count=2, more=f"keep: failed\n{unmet}\n"), out)
    assert flown.returncode == 0
    assert "2 of 2 runs did not pass" in flown.stdout
    runs = list(out.glob("mine/runs/*/run"))
    assert len(runs) == 2
    for run in runs:
        assert {path.name for path in run.glob("*")} & {"run.mcap", "tlog", "deliveries.parquet"} == {
            "deliveries.parquet"
        }
        assert sorted(path.name for path in (run / "logs").glob("*"))[0] == "fleet.log"  # it flew as one


def test_rows_as_json(make_study, tmp_path):
    flown = fly(make_study(count=2), tmp_path / "out", "--json")
    rows = [json.loads(line) for line in flown.stdout.splitlines()]
    assert [row["radio"] for row in rows] == ["moon2020", "corrected"]
    assert all(row["frames_are_there"] for row in rows)  # imported once per worker, by no case
