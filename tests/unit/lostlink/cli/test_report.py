"""`lostlink report` writes a page, prints numbers, and says what it cannot read."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from lostlink.cli import now_and_then
from lostlink.cli.records.report import report
from tests.unit.lostlink.replay.flown import flown, scenario_of


def run(*arguments: object) -> Result:
    return CliRunner().invoke(report, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flown(tmp_path_factory.mktemp("runs") / "made", scenario_of("moon2020", ("0", "1")))


def test_a_page_is_in_the_run_and_it_is_not_silent_for_long(made: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(now_and_then, "NEWS_PERIOD_S", 0.0)
    done = run(made)
    assert (done.exit_code, done.stdout) == (0, f"{made}/report.html\n")
    assert (made / "report.html").exists()
    assert "report: reads the deliveries" in done.stderr
    assert "report: draws map" in done.stderr


@pytest.mark.slow
def test_json_alone_or_with_a_page_where_it_is_wanted(made: Path, tmp_path: Path):
    done = run(made, "--json")
    content = json.loads(done.stdout)
    assert (done.exit_code, content["schema"], content["run"]["name"]) == (0, 1, "made")
    assert content["totals"]["sent"] == 120
    both = run(made, "--json", "--out", tmp_path / "a.html")
    assert both.exit_code == 0
    assert both.stderr.splitlines()[-1] == f"{tmp_path}/a.html"
    assert json.loads(both.stdout) == content
    assert f"{100 * content['totals']['delivery']:.1f} %" in (tmp_path / "a.html").read_text()


def test_what_cannot_be_read_or_written_has_status_2(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    assert run(tmp_path).exit_code == 2
    assert "is not the directory of a run" in run(tmp_path / "nowhere").output
    monkeypatch.setattr(now_and_then, "NEWS_PERIOD_S", 0.0)
    done = run(made, "--out", tmp_path / "no" / "a.html")
    assert done.exit_code == 2
    assert f"--out {tmp_path}/no/a.html: there is no directory {tmp_path}/no; make it first" in done.stderr
    assert "report: " not in done.stderr, "it is told before anything is read"
