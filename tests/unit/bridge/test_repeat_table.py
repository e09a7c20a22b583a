"""The table of repeats counts no run that broke off, and flies each line as the line says."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml

from benchmarks import repeat
from benchmarks.repeat import Line, check, lines

SUMMARY: dict[str, Any] = {
    "ending": "duration",
    "error": None,
    "sim_duration_s": 8.0,
    "real_time_factor": 2.0,
    "digests": {"truth": "ab"},
    "may_not_repeat": [],
}


class FakeRuns:
    """Stands for `lostlink run`: each run gives the next of ``summaries``."""

    def __init__(self, summaries: Sequence[dict[str, Any]]) -> None:
        self.summaries = iter(summaries)
        self.slots: list[int] = []

    def __call__(self, command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        scenario, runs = Path(command[4]), Path(command[-1])
        self.slots.append(yaml.safe_load(scenario.read_text())["ports"]["first_slot"])
        (runs / "run").mkdir(parents=True)
        summary = next(self.summaries)
        return subprocess.CompletedProcess(
            command, int(summary["ending"] == "failed"), json.dumps(summary), ""
        )


def flown(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, summaries: Sequence[dict[str, Any]], line: Line
) -> tuple[dict[str, Any], list[int]]:
    fake = FakeRuns(summaries)
    monkeypatch.setattr(repeat.subprocess, "run", fake)  # type: ignore[attr-defined]
    return check(line, len(summaries) - 1, True, tmp_path, 40), fake.slots


def named(name: str) -> Line:
    return next(line for line in lines() if line.name == name)


FAILED = SUMMARY | {"ending": "failed", "error": "physics ended"}


@pytest.mark.parametrize("broken", [FAILED, SUMMARY | {"ending": "interrupted"}])
def test_runs_that_broke_off_are_not_identical_however_equal(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, broken: dict[str, Any]
) -> None:
    row, _ = flown(monkeypatch, tmp_path / "a", [SUMMARY, broken, SUMMARY], named("standin quiet"))
    assert row["identical"] == 1
    assert row["remarks"] == [f"repeat 0: the run ended as {broken['ending']!r}: {broken['error']}"]
    row, slots = flown(monkeypatch, tmp_path / "b", [broken, broken], named("standin quiet"))
    assert (row["identical"], len(slots)) == (0, 1)
    assert row["remarks"][0].startswith("reference: the run ended as")
    assert repeat.table([row])


def test_ports_and_placement_are_others_in_one_line_each(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    row, slots = flown(monkeypatch, tmp_path, [SUMMARY, SUMMARY], named("standin ports"))
    assert (row["identical"], slots) == (1, [40, 42])
    shared = named("standin shared")
    assert (shared.base["fdm.placement"], shared.other["fdm.placement"]) == ("spread", "shared")
