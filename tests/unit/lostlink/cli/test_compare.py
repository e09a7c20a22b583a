"""`lostlink compare` says identical, or where two runs begin to differ, with a status for scripts."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from bridge.record.names import packets
from bridge.record.provenance import Provenance, write_provenance
from bridge.run.directory import RunDirectory
from bridge.scenario.file import read_scenario
from lostlink.cli import now_and_then
from lostlink.cli.records.compare import compare
from tests.unit.bridge.record.runs import make_run


def run(*arguments: object) -> Result:
    return CliRunner().invoke(compare, [str(a) for a in arguments])


def test_identical_runs(tmp_path: Path) -> None:
    done = run(make_run(tmp_path / "a"), make_run(tmp_path / "b"))
    assert (done.exit_code, done.output) == (
        0,
        "identical: truth, deliveries, 6 streams; 168 entries, 20 ticks\n",
    )


def test_a_run_that_goes_on_is_not_compared(tmp_path: Path) -> None:
    """Its parts grow while they are read, so that not even with itself it would be the same."""
    b = make_run(tmp_path / "b", is_finished=False)
    with RunDirectory(b).going_on():
        done = run(make_run(tmp_path / "a"), b)
    assert done.exit_code == 2
    assert f"{b}: this run has not ended yet" in done.stderr
    assert run(tmp_path / "a", b).exit_code == 0


def test_runs_may_be_named_as_they_are_in_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a", "b"):
        make_run(tmp_path / "runs" / name)
    monkeypatch.chdir(tmp_path)
    done = run("a", "b")
    assert (done.exit_code, done.output.split(":")[0]) == (0, "identical")


def test_first_difference_with_both_values(tmp_path: Path) -> None:
    b = make_run(tmp_path / "b", lambda run: run.change_row(7, fate="burst"))
    done = run(make_run(tmp_path / "a"), b)
    assert done.exit_code == 1
    assert done.output.splitlines() == [
        "first difference at 0.15 s of sim time: node 1, deliveries, fate in row 7",
        f"  {tmp_path}/a: delivered",
        f"  {tmp_path}/b: burst",
    ]


def test_json_has_the_same(tmp_path: Path) -> None:
    a, b = make_run(tmp_path / "a"), make_run(tmp_path / "b", lambda run: run.streams.pop(packets("1")))
    done = run(a, b, "--json")
    content = json.loads(done.output)
    assert (done.exit_code, content["identical"]) == (1, False)
    assert content["difference"] == {
        "tick_ns": 0,
        "node": "1",
        "stream": "packets/1",
        "what": "the stream",
        "a": "a stream that begins at 0.00 s",
        "b": "no such stream",
    }
    same = json.loads(run(a, a, "--json").output)
    assert (same["identical"], same["difference"], same["ticks"]) == (True, None, 20)


def test_runs_of_other_lostlinks_name_them_in_a_line(tmp_path: Path) -> None:
    a, b, c = (make_run(tmp_path / name) for name in "abc")
    assert json.loads(run(a, b, "--json").output)["made_by"] == {}
    for made, commit in ((a, "a" * 40), (b, "b" * 40)):
        write_provenance(Provenance("0.1.0", commit), made)
    of_a, of_b = (f"lostlink 0.1.0 at commit {letter * 40}" for letter in "ab")
    assert run(a, b).output.splitlines()[1:] == [f"{of_a} made {a}; {of_b} made {b}"]
    assert json.loads(run(a, b, "--json").output)["made_by"] == {str(a): of_a, str(b): of_b}
    assert run(a, c).output.splitlines()[1:] == [f"{of_a} made {a}; it is not known what made {c}"]
    write_provenance(Provenance("0.1.0", "a" * 40), b)
    assert len(run(a, b).output.splitlines()) == 1


def test_what_cannot_be_read_has_status_2(tmp_path: Path) -> None:
    a, b = make_run(tmp_path / "a"), make_run(tmp_path / "b")
    packets("1").path(b).write_bytes(b"LLSTREAM\x09\0\0\0")
    for done, text in (
        (run(a, tmp_path / "c"), "c: no such directory"),
        (run(a, b), "packets/1.bin: offset 8: version 9"),
    ):
        assert done.exit_code == 2
        assert text in done.output
        assert "Traceback" not in done.output


def test_long_comparison_is_seen_to_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(now_and_then, "NEWS_PERIOD_S", 0.0)
    done = run(make_run(tmp_path / "a", ticks=400), make_run(tmp_path / "b", ticks=400))
    assert "comparing mavlink/0/from_autopilot: 1000 entries so far" in done.stderr
    assert done.stdout.startswith("identical: ")


def test_of_runs_of_other_scenarios_it_says_in_what_they_differ_and_what_came_of_each(tmp_path: Path) -> None:
    a, b = make_run(tmp_path / "a"), make_run(tmp_path / "b", lambda run: run.change_row(7, fate="burst"))
    for path, setting in ((a, {}), (b, {"nodes.1.agent.speed_mps": 7.5, "processes": "many"})):
        RunDirectory(path).write(read_scenario("separation", setting), "")
    done = run(a, b)
    assert done.exit_code == 1
    first, *_, last = done.output.splitlines()
    assert first.startswith("first difference at 0.15 s")
    rows = [
        [cell.strip() for cell in line.split("│")[1:-1]] for line in done.output.splitlines() if "│" in line
    ]
    assert ["nodes.1.agent.speed_mps", "10", "7.5"] in rows
    assert ["packets delivered", "40", "39"] in rows
    assert "processes" not in done.output
    assert last == "No two of these runs have the same digest."
    assert json.loads(run(a, b, "--json").output)["settings"] == {"nodes.1.agent.speed_mps": [10.0, 7.5]}
    RunDirectory(b).write(read_scenario("separation"), "")
    assert len(run(a, b).output.splitlines()) == 3
