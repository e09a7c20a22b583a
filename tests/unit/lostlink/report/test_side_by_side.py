"""Runs side by side: what differs, what is the same, and what has no figure."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from bridge.record.digests import digest_line
from lostlink.cli.records.compare import compare
from lostlink.reading.run import load_run
from lostlink.report.side_by_side import (
    LINKS_MAX,
    SETTINGS_MAX,
    comparison_page,
    sameness,
    side_by_side,
    table_of,
)
from tests.unit.lostlink.replay.flown import flown, scenario_of


def run(*arguments: object) -> Result:
    return CliRunner().invoke(compare, [str(a) for a in arguments])


def made(
    path: Path, *, seed: int = 1, nodes: tuple[str, ...] = ("0", "1"), digest: str = "", **options: Any
) -> Path:
    flown(path, scenario_of("moon2020", nodes, seed), **options)
    if not options.get("killed"):
        failed = {"name": "far out", "passed": False}
        summary = {
            "ending": "duration",
            "outcome": "fail",
            "verdict": "fail: 1 of 1 expectations not met: far out; 6 checks",
            "digest": digest,
            "expectations": [failed],
        }
        (path / "summary.json").write_text(json.dumps(summary))
    return path


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two alike, one of another seed, one that was killed and has a node more."""
    folder = tmp_path_factory.mktemp("runs")
    return [
        made(folder / "a", digest="d1"),
        made(folder / "b", digest="d1"),
        made(folder / "c", seed=2, digest="d2"),
        made(folder / "d", nodes=("0", "1", "gcs"), killed=True),
    ]


def test_runs_that_recorded_nothing_are_not_called_identical(tmp_path: Path):
    for name in ("a", "b"):
        made(tmp_path / name, digest=digest_line({}))
        file = tmp_path / name / "summary.json"
        file.write_text(json.dumps(json.loads(file.read_text()) | {"digests": {}}))
        shutil.rmtree(tmp_path / name / "streams")
        for table in (tmp_path / name).glob("*.parquet"):
            table.unlink()
    content = side_by_side([load_run(tmp_path / name) for name in ("a", "b")])
    assert [column["digest"] for column in content["runs"]] == ["", ""]
    assert sameness(content) == "No two of these runs have the same digest."


def test_what_differs_and_what_does_not(runs: list[Path]):
    content = side_by_side([load_run(path) for path in runs])
    assert content["settings"] == {"nodes": [2, 2, 2, 3], "seed": [1, 1, 2, 1]}
    rows = {name: (cells, differs) for name, cells, differs in table_of(content)}
    assert "made by" not in rows
    other = [run | {"made_by": f"lostlink {k}"} for k, run in enumerate(content["runs"])]
    assert table_of(content | {"runs": other})[2] == ("made by", [f"lostlink {k}" for k in range(4)], True)
    assert rows["seed"] == (["1", "1", "2", "1"], True)
    assert rows["scenario"] == (["made"] * 4, False)
    assert rows["outcome"] == (["fail"] * 3 + ["–"], True)
    assert rows["failed expectations"][0] == ["far out"] * 3 + ["none"]
    assert rows["delivery gcs to 0"][0][:3] == ["–"] * 3
    assert [column["same_as"] for column in content["runs"]] == ["a", "a", "c", None]
    assert sameness(content) == "Equal digests: a and b. The others differ."
    assert sameness(content | {"runs": content["runs"][:2]}).startswith("All digests are equal")
    assert sameness(content | {"runs": content["runs"][1:3]}).startswith("No two")


def test_figures_are_those_of_each_run(runs: list[Path]):
    content = side_by_side([load_run(path) for path in runs])
    for path, column in zip(runs, content["runs"], strict=True):
        frame = load_run(path).links
        assert [column["sent"], column["delivered"]] == [frame.sent.sum(), frame.delivered.sum()]
        assert column["age_peak_s"] == load_run(path).ages.peak_s.max()
        by_distance = column["delivery_by_distance"]
        assert sum(row["delivered"] for row in by_distance) == column["delivered"]


def test_many_settings_are_cut(runs: list[Path]):
    content = side_by_side([load_run(path) for path in runs[:2]])
    many = content | {"settings": {f"key{i}": [1, 2] for i in range(SETTINGS_MAX + 5)}}
    names = [name for name, _, _ in table_of(many)]
    assert "5 more settings: see the JSON" in names
    assert f"key{SETTINGS_MAX}" not in names


def test_links_that_are_left_out_are_told(runs: list[Path]) -> None:
    """Of 25 links one differs: it is there, and the table says how many are not."""
    content = side_by_side([load_run(path) for path in runs[:2]])
    columns = [
        column
        | {
            "links": [
                {"radio": "main", "tx": str(i), "rx": "gcs", "delivery": 0.5 if i == 24 and number else 1.0}
                for i in range(25)
            ]
        }
        for number, column in enumerate(content["runs"])
    ]
    rows = table_of(content | {"runs": columns})
    told = [row for row in rows if row[0].startswith("delivery ")]
    assert len(told) == LINKS_MAX
    assert told[0] == ("delivery 24 to gcs", ["100.0 %", "50.0 %"], True)
    assert rows[-2] == (
        f"{25 - LINKS_MAX} more links, which differ no more than these: see the JSON",
        ["", ""],
        False,
    )
    assert not any("more links" in name for name, _, _ in table_of(content))


def test_page_asks_for_nothing(runs: list[Path]):
    text = comparison_page(side_by_side([load_run(path) for path in runs]))
    assert re.search(r"\b(https?|ftp|wss?):", text) is None
    assert text.count('<th scope="col" class="number">') == 4
    assert 'role="img"' in text


def test_table_on_the_terminal_as_json_and_as_a_page(runs: list[Path], tmp_path: Path):
    done = run(*runs)
    assert (done.exit_code, "share delivered" in done.output) == (0, True)
    assert done.output.endswith("Equal digests: a and b. The others differ.\n")
    content = json.loads(run(*runs, "--json").output)
    assert [each["name"] for each in content["runs"]] == ["a", "b", "c", "d"]
    page = run(*runs[:2], "--html", tmp_path / "c.html")
    assert page.exit_code == 0
    assert (tmp_path / "c.html").read_text().startswith("<!DOCTYPE html>")
    assert "share delivered" in run(*runs[:2], "--metrics").output


def test_two_runs_alone_are_compared_for_identity(runs: list[Path]):
    assert run(*runs[:2]).output.startswith("identical: truth, states, deliveries")
    assert run(runs[0], runs[2]).exit_code == 1


def test_mistakes_have_status_2(runs: list[Path], tmp_path: Path):
    assert "give another one" in run(runs[0]).output
    for done in (run(runs[0]), run(), run(*runs, tmp_path / "nowhere")):
        assert done.exit_code == 2


def test_runs_with_as_many_nodes_and_others_differ(tmp_path: Path):
    paths = [made(tmp_path / name, nodes=("0", name)) for name in ("1", "5")]
    settings = side_by_side([load_run(path) for path in paths])["settings"]
    assert settings == {"nodes.id": ["1", "5"]}
    assert "The scenarios differ" in run(*paths).stdout
