"""`lostlink study` where all runs are done: its table, its figures, its rows as JSON."""

from __future__ import annotations

import io
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from rich.console import Console

from bridge.run.every import Every
from lostlink.cli.flying.study import _show, study
from lostlink.study.case_process import RESULT_FILE, CasePlan, read_result, write_whole
from lostlink.study.cases import Case
from lostlink.study.lanes import LocalLanes
from lostlink.study.made_of import MadeOf
from lostlink.study.study import Standing, Study
from lostlink.study.table import TABLE_FILE
from tests.unit.lostlink.replay.flown import scenario_of

FIGURES = """
def broken(table, directory):
    raise KeyError("speed")


def ends(table, directory):
    raise SystemExit(0)


def drawn(table, directory):
    (directory / "drawn.txt").write_text(str(len(table)))
"""


@pytest.fixture(autouse=True)
def _same_handlers() -> Iterator[None]:
    """The command sets handlers of signals for its process."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A study of two runs, both done."""
    (tmp_path / "own.py").write_text(FIGURES, encoding="utf-8")
    file = tmp_path / "study.yaml"
    file.write_text(
        "schema: 1\nname: mine\nscenario: separation\nseeds: [1, 2]\n"
        "figures: [own.py:broken, own.py:ends, own.py:drawn]\n",
        encoding="utf-8",
    )
    ours = Study(file, tmp_path)
    measures = CasePlan("", (), "all").measures
    for case in ours.cases:
        ours.path(case).mkdir(parents=True)
        delivery = float("nan") if case.labels["seed"] == 1 else 0.5
        metrics = {"passed": True, "delivery": delivery, "series": [1.0, float("inf")]}
        content = {"failure": "", "measures": measures, "metrics": metrics, "timing": {}}
        write_whole(ours.path(case) / RESULT_FILE, content)
        ours._plan(case).write(ours.path(case))
    return file


def run(file: Path, *arguments: str) -> Result:
    return CliRunner().invoke(study, [str(file), "--out", str(file.parent), *arguments])


def test_a_figure_that_fails_is_told_in_a_line_after_the_table_and_the_others_are_drawn(file: Path) -> None:
    done = run(file)
    assert done.exit_code == 1
    assert done.stdout.splitlines()[-1] == str(file.parent / "mine" / "metrics.parquet")
    place = f"lostlink: {file.parent / 'own.py'}"
    assert done.stderr == f"{place}:broken: KeyError: 'speed'\n{place}:ends: SystemExit: 0\n"
    assert (file.parent / "mine" / "drawn.txt").read_text() == "2"


def test_the_means_of_each_setting_are_shown_and_not_in_json(file: Path) -> None:
    shown = run(file).stdout
    assert "means over the seeds ± standard error\n" in shown
    assert " runs   passed    delivery " in shown
    assert "2        2   0.5 (n=1)" in shown
    assert "passed  " not in run(file, "--json").stdout


@pytest.mark.parametrize("as_json", [False, True])
def test_an_interrupted_study_shows_the_runs_that_are_over(
    file: Path, monkeypatch: pytest.MonkeyPatch, as_json: bool
) -> None:
    text = file.read_text(encoding="utf-8").replace(
        "seeds: [1, 2]", "seeds: [1, 2]\nvary: {radio: {moon: moon2020}}"
    )
    file.write_text(text.replace("name: mine", "name: varied"), encoding="utf-8")
    ours = Study(file, file.parent)
    measures = CasePlan("", (), "all").measures
    ours.path(ours.cases[0]).mkdir(parents=True)
    content = {
        "failure": "",
        "measures": measures,
        "metrics": {"passed": True, "delivery": 0.75},
        "timing": {},
    }
    write_whole(ours.path(ours.cases[0]) / RESULT_FILE, content)

    def interrupted(*_: object) -> Iterator[Standing]:
        os.kill(os.getpid(), signal.SIGINT)
        yield Standing(1, 0, 2)

    monkeypatch.setattr(Study, "fly", interrupted)
    done = run(file, "--lanes", "1", *(["--json"] if as_json else []))
    assert done.exit_code == 128 + signal.SIGINT
    assert "interrupted: start it again to go on" in done.stderr
    assert "1 of 2 runs are over" in done.output
    if as_json:
        assert [json.loads(line)["delivery"] for line in done.stdout.splitlines()] == [0.75]
    else:
        assert "0.75" in done.stdout
    assert not (ours.directory / TABLE_FILE).exists()


class _Nowhere(LocalLanes):
    """Lanes on which a study is interrupted before a run is over."""

    def fly(self, cases: Sequence[Path]) -> Iterator[Path | None]:
        os.kill(os.getpid(), signal.SIGINT)
        yield None


def test_an_interrupted_study_shows_nothing_that_is_to_be_measured_again(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of results of other code and of this one means are none."""
    with (file.parent / "own.py").open("a", encoding="utf-8") as own:
        own.write("\n\ndef more(run):\n    return {}\n")
    file.write_text(file.read_text(encoding="utf-8") + "metrics: own.py:more\n", encoding="utf-8")
    monkeypatch.setattr("lostlink.cli.flying.study.LocalLanes", _Nowhere)
    done = run(file, "--lanes", "1", "--json")
    assert (done.exit_code, done.stdout) == (128 + signal.SIGINT, "")
    assert "0 of 2 runs are over" in done.stderr


def test_a_run_that_another_study_has_flown_since_this_one_looked_keeps_its_result(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours = Study(file, file.parent)
    monkeypatch.setattr(ours, "left", lambda: ours.cases)
    next(ours.fly(_Nowhere(1)))
    assert [row["failure"] for row in ours.rows()] == ["", ""]


def test_json_has_null_for_what_is_no_number(file: Path) -> None:
    rows = [json.loads(line, parse_constant=pytest.fail) for line in run(file, "--json").stdout.splitlines()]
    assert [(row["seed"], row["delivery"], row["series"]) for row in rows] == [
        (1, None, [1.0, None]),
        (2, 0.5, [1.0, None]),
    ]


def test_labels_and_names_of_files_are_no_markup(file: Path) -> None:
    text = file.read_text(encoding="utf-8").replace(
        "seeds: [1, 2]", 'vary: {radio: {"[/x] far": perfect, ":boom:": disk}}'
    )
    file.write_text(text, encoding="utf-8")
    done = run(file, "--dry-run")
    assert done.exit_code == 0, done.output
    assert "radio [/x] far, seed 1" in done.stdout
    assert "radio :boom:, seed 1" in done.stdout


def test_each_line_of_a_mistake_has_the_commands_name(file: Path) -> None:
    file.write_text("schema: 1\nname: mine\nnodes: []\n", encoding="utf-8")
    done = run(file, "--dry-run")
    assert done.exit_code == 2
    missing, unknown = done.stderr.splitlines()[-2:]
    assert missing.startswith(f"lostlink: {file}:3: scenario: is required")
    assert unknown.startswith(f"lostlink: {file}:3: nodes: unknown key")


def test_seeds_are_not_varied(file: Path) -> None:
    file.write_text("schema: 1\nname: mine\nscenario: separation\nvary: {seed: [1, 2]}\n", encoding="utf-8")
    done = run(file, "--dry-run")
    assert done.exit_code == 2
    assert "vary: seed is given by seeds:, as seeds: [1, 2]" in done.stderr


def test_figures_without_pandas_are_refused_before_anything_flies(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    done = run(file, "--dry-run")
    assert (done.exit_code, done.stdout) == (2, f"{file}: reads the scenario of each run\n")
    assert "figures: needs pandas: pip install 'lostlink[pandas]'" in done.stderr


@pytest.mark.parametrize("as_json", [False, True])
def test_why_runs_with_results_are_flown_again_is_told_in_a_line(
    file: Path, monkeypatch: pytest.MonkeyPatch, as_json: bool
) -> None:
    (before,) = {case.made_of.lostlink for case in Study(file, file.parent).cases}
    monkeypatch.setattr("lostlink.study.made_of.git_commit", lambda: "a" * 40)
    (now,) = {case.made_of.lostlink for case in Study(file, file.parent).cases}
    told = run(file, "--dry-run", *(["--json"] if as_json else []))
    why = f"{now} in place of {before}"
    assert f"to fly: 2\n2 earlier results do not count: {why}\n" in (told.stderr if as_json else told.stdout)
    if as_json:
        rows = [json.loads(line) for line in told.stdout.splitlines()]
        assert [(row["seed"], row["standing"], row["earlier"]) for row in rows] == [
            (1, "to fly", why),
            (2, "to fly", why),
        ]


def test_runs_that_are_only_measured_again_say_nothing_of_flights(monkeypatch: pytest.MonkeyPatch) -> None:
    clock_s = iter([0.0, 61.0, 61.0])
    monkeypatch.setattr("lostlink.cli.flying.study.monotonic", lambda: next(clock_s))
    monkeypatch.setattr(Every, "is_due", lambda _self: True)
    case = Case({"seed": 1}, scenario_of("perfect", ("0", "1")), MadeOf())
    text = io.StringIO()
    measured, flown = Standing(1, 0, 4, case, "", 0, 3), Standing(2, 0, 4, case, "", 1, 2)
    _show(iter([Standing(0, 0, 4), measured, flown]), Console(file=text, width=200))
    assert text.getvalue().splitlines() == [
        "0 of 4 runs",
        "1 of 4 runs",
        "2 of 4 runs, about 2 min 2 s remain",
    ]


def test_what_is_longer_than_it_was_to_take_has_no_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that stands still is given up after much longer than others take."""
    clock_s = iter([0.0, 8.0, 8.0, 10.0, 100.0, 100.0, 101.0])
    monkeypatch.setattr("lostlink.cli.flying.study.monotonic", lambda: next(clock_s))
    monkeypatch.setattr(Every, "is_due", lambda _self: True)
    case = Case({"seed": 1}, scenario_of("perfect", ("0", "1")), MadeOf())
    over, standing = Standing(1, 0, 2, case), Standing(1, 0, 2)
    text = io.StringIO()
    last = Standing(2, 0, 2, case)
    _show(iter([Standing(0, 0, 2), over, standing, standing, last]), Console(file=text, width=200))
    assert text.getvalue().splitlines() == [
        "0 of 2 runs",
        "1 of 2 runs, about 0 min 8 s remain",
        "1 of 2 runs, about 0 min 6 s remain",
        "1 of 2 runs, the next takes longer than those before",
        "2 of 2 runs",
    ]


@pytest.mark.slow
def test_each_case_of_a_study_has_the_folder_of_px4_in_its_own_process(tmp_path: Path) -> None:
    file = tmp_path / "study.yaml"
    file.write_text("schema: 1\nname: mine\nscenario: separation\nset: {autopilot: px4}\n", encoding="utf-8")
    done = run(file, "--lanes", "1", "--px4-dir", str(tmp_path))
    assert done.exit_code == 1, done.output
    (directory,) = (tmp_path / "mine" / "runs").iterdir()
    assert CasePlan.read(directory).dirs.px4 == tmp_path
    result = read_result(directory)
    assert result is not None
    assert f"{tmp_path}/bin/px4" in result["failure"]


@pytest.fixture
def to_fly(tmp_path: Path) -> Path:
    """A study of one run."""
    file = tmp_path / "study.yaml"
    file.write_text("schema: 1\nname: mine\nscenario: separation\nseeds: [1]\n", encoding="utf-8")
    return file


def test_a_scheduler_that_does_not_answer_is_waited_for_aloud(
    to_fly: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("lostlink.study.lanes.DASK_PATIENCE_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        done = run(to_fly, "--scheduler", address)
    assert done.exit_code == 2
    assert done.stdout.splitlines()[-1] == f"joins the Dask scheduler at {address}, within 10 s"
    assert done.stderr == f"lostlink: no Dask scheduler answers at {address}: not within 0.2 s\n"


def test_an_address_that_is_none_is_refused_at_once_and_leaves_nothing_to_end(to_fly: Path) -> None:
    pytest.importorskip("distributed")
    words = [
        "-m",
        "lostlink",
        "study",
        str(to_fly),
        "--out",
        str(to_fly.parent),
        "--scheduler",
        "tcp://127.0.0.1",
    ]
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr == (
        "lostlink: no Dask scheduler answers at tcp://127.0.0.1: missing port number in address '127.0.0.1'\n"
    )
