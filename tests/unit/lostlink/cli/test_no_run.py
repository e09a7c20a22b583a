"""What commands say where there is no run, or none could be written."""

from __future__ import annotations

import errno
import os
import re
import signal
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner
from rich.console import Console

from bridge.record.provenance import Provenance, write_provenance
from bridge.scenario.file import ScenarioError
from lostlink import load_run
from lostlink.cli import main as command
from lostlink.cli.shown_flight import ShownFlight
from lostlink.flight.flight import Flight
from tests.unit.bridge.record.runs import make_run
from tests.unit.lostlink.replay.flown import flown, scenario_of


@pytest.mark.parametrize("name", ["redecide", "replay", "report"])
def test_a_directory_that_is_no_run_is_told(name: str, tmp_path: Path) -> None:
    done = CliRunner().invoke(command.lostlink, [name, str(tmp_path / "nosuch")], standalone_mode=False)
    assert done.exit_code == 2
    assert f"{tmp_path / 'nosuch'} is not the directory of a run (it has no scenario.yaml)" in done.output
    assert "Errno" not in done.output


@pytest.mark.parametrize(
    "words",
    [
        "redecide A",
        pytest.param("report A", marks=pytest.mark.slow),
        "judge A",
        "export A --csv",
        "compare A A",
        "compare A --metrics",
    ],
)
def test_a_run_may_be_named_by_its_name_in_runs(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "runs").mkdir()
    flown(tmp_path / "runs" / "A", scenario_of("moon2020", ("0", "1")), 5)
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(command.lostlink, words.split(), standalone_mode=False)
    assert done.exit_code == 0, done.output


NO_SCENARIOS = {
    "- 1": ":1: a scenario is a mapping of keys to values",
    "hello": ":1: a scenario is a mapping of keys to values",
    "": ":1: a scenario is a mapping of keys to values",
    "name: [1": ":1: is not YAML: expected ',' or ']', but got '<stream end>'",
    "name: a\nseed: x": ":2: seed: has to be a whole number (got 'x')",
    "name: a\nseed: !!bool maybe": ":2: is not YAML: 'maybe'",
    "name: a\nseed: 2026-13-45": ":2: is not YAML: month must be in 1..12",
    "name: a\nseed: &a [*a]": ":2: an alias of what it is in",
    "name: \udcff": ": cannot be read: 'utf-8' codec can't decode byte 0xff in position 6: invalid start byte",
}


@pytest.mark.parametrize("content", NO_SCENARIOS)
@pytest.mark.parametrize("words", ["redecide", "replay", "report", "judge", "refly", "export --mcap"])
def test_a_record_whose_scenario_is_none_is_told_with_file_and_line(
    words: str, content: str, tmp_path: Path
) -> None:
    file = make_run(tmp_path / "run") / "scenario.yaml"
    file.write_bytes(content.encode(errors="surrogateescape"))
    done = CliRunner().invoke(command.lostlink, [*words.split(), str(file.parent)], standalone_mode=False)
    assert done.exit_code == 2, done.exception
    assert f"{file}{NO_SCENARIOS[content]}" in done.output
    assert "pydantic" not in done.output
    with pytest.raises(ScenarioError, match=re.escape(f"{file}{NO_SCENARIOS[content]}")):
        _ = load_run(file.parent).scenario


COMMIT = f"{'0123456789abcdef':0<40}-dirty-00"
NOTE = f"another version has made this record: lostlink 0.0.9 at commit {COMMIT}; this is lostlink "


@pytest.mark.parametrize(
    "words",
    ["redecide", "replay", "report", "judge", "refly", "export --mcap", "compare --metrics", "compare"],
)
def test_of_a_record_of_another_version_that_cannot_be_read_that_is_told_once(
    words: str, tmp_path: Path
) -> None:
    run = make_run(tmp_path / "run")
    if words == "compare":  # it reads no scenario first
        (run / "streams" / "truth").mkdir()
        (run / "streams" / "truth" / "0.bin").write_bytes(b"")
        words = f"compare {run}"
    else:
        (run / "scenario.yaml").write_text("schema: 1\nname: old\nua: [{id: 0}]\n")
    done = CliRunner().invoke(command.lostlink, [*words.split(), str(run)], standalone_mode=False)
    assert done.exit_code == 2, done.exception
    assert "another version" not in done.output, "what made it is not known"
    made = Provenance(lostlink="0.0.9", git_commit=COMMIT)
    write_provenance(made, run)
    done = CliRunner().invoke(command.lostlink, [*words.split(), str(run)], standalone_mode=False)
    assert done.exit_code == 2, done.exception
    assert done.output.splitlines()[-1].startswith(f"lostlink: {run}: {NOTE}")
    assert done.output.count("another version") == 1


@pytest.mark.parametrize("words", ["redecide", "report", "compare --metrics"])
def test_of_a_table_of_another_version_that_cannot_be_read_that_is_told(words: str, tmp_path: Path) -> None:
    run = tmp_path / "run"
    flown(run, scenario_of("moon2020", ("0", "1")), 5)
    (run / "deliveries.parquet").write_bytes(b"damaged")
    write_provenance(Provenance(lostlink="0.0.9", git_commit=COMMIT), run)
    done = CliRunner().invoke(command.lostlink, [*words.split(), str(run)], standalone_mode=False)
    assert done.exit_code == 2, done.exception
    assert done.output.splitlines()[-1].startswith(f"lostlink: {run}: {NOTE}")


@pytest.mark.parametrize(
    ("words", "says"),
    [("refly --speed -1", "speed: has to be"), ("compare nosuch", "nosuch: no such directory")],
)
def test_what_is_no_mistake_of_a_record_is_not_put_down_to_its_version(
    words: str, says: str, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    flown(run, scenario_of("moon2020", ("0", "1")), 5)
    write_provenance(Provenance(lostlink="0.0.9", git_commit=COMMIT), run)
    done = CliRunner().invoke(command.lostlink, [*words.split(), str(run)], standalone_mode=False)
    assert done.exit_code == 2, done.exception
    assert says in done.output
    assert "another version" not in done.output


def test_a_disk_that_is_too_full_for_a_summary_is_told_with_its_place_and_what_to_do(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Flight, "fly", full)
    flight = object.__new__(ShownFlight)
    flight.console, flight.quiet = Console(), True
    flight.directory = SimpleNamespace(path=Path("runs/a"))  # type: ignore[assignment]
    assert flight.fly_and_tell() is None
    said = capsys.readouterr().err
    assert said.startswith("lostlink: runs/a: [Errno 28] No space left on device; the run has no summary; ")
    assert "`lostlink export runs/a --parquet --mcap`" in said


def test_ctrl_c_that_nothing_else_heeds_ends_with_its_status(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(**_: object) -> None:
        raise command.click.Abort

    monkeypatch.setattr(command, "lostlink", interrupted)
    with pytest.raises(SystemExit) as ended:
        command.main()
    assert ended.value.code == 128 + signal.SIGINT
    assert capsys.readouterr().err == "lostlink: interrupted\n"
