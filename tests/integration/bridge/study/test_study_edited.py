"""Files that are edited while a study flies: no run counts as one of what the study was read with."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.warm import run_lostlink

AGENT = """
from pathlib import Path

import laws
from bridge.agents import Agent


class Mine(Agent):
    async def fly(self):
        await self.sleep(0.8)

    def on_tick(self, sim_time_ns):
        super().on_tick(sim_time_ns)
        if sim_time_ns == 500_000_000 and self.options["edits"]:
            Path(laws.__file__).write_text("GAIN = 3\\n", encoding="utf-8")
"""
SCENARIO = """
schema: 1
name: near
duration_s: 1
speed: max
origin: {lat_deg: 40.13, lon_deg: -105.24, alt_amsl_m: 1690}
radio: perfect
nodes:
  - {id: 0, kind: ground, place: {}, agent: {type: own, class: "mine.py:Mine", options: {edits: false}}}
  - {id: 1, home: {north_m: 380}, agent: {type: still}}
"""
OWN = """
from pathlib import Path


def measure(run):
    if run.scenario.seed == 1:
        Path(__file__).with_name("laws.py").write_text("GAIN = 3\\n", encoding="utf-8")
    return {}
"""
STUDY = """
schema: 1
name: mine
scenario: near.yaml
"""
EDITED = (
    "no result of this run, as something was changed after the study was read: other files (laws.py); "
    "start the study again"
)
EDITED_WHILE_IT_FLEW = (
    "no result of this run, as something was changed while it flew: other files (laws.py); start the study again; "
    "an agent that writes to a file that the scenario names does so in each run: it has self.directory"
)

pytestmark = pytest.mark.slow


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    texts = {"near.yaml": SCENARIO, "mine.py": AGENT, "own.py": OWN, "laws.py": "GAIN = 2\n"}
    for name, text in texts.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def study(folder: Path, *options: str) -> list[dict]:
    command = ["study", folder / "study.yaml", "--out", folder, "--lanes", "1", "--json", *options]
    return [json.loads(line) for line in run_lostlink(*command, timeout=120).stdout.splitlines()]


def test_a_file_that_is_edited_after_a_run_is_no_other_runs(folder: Path) -> None:
    """Not even when it is again what it was: then what did not fly it is flown."""
    (folder / "study.yaml").write_text(
        f"{STUDY}seeds: [1, 2, 3]\nmetrics: own.py:measure\n", encoding="utf-8"
    )
    assert [row["failure"] for row in study(folder)] == ["", EDITED, EDITED]
    (folder / "laws.py").write_text("GAIN = 2\n", encoding="utf-8")
    assert [row["standing"] for row in study(folder, "--dry-run")] == ["done", "to fly", "to fly"]


def test_a_file_that_is_edited_while_a_run_flies_makes_it_no_result(folder: Path) -> None:
    (folder / "study.yaml").write_text(
        f"{STUDY}keep: none\nset: {{nodes.0.agent.options.edits: true}}\n", encoding="utf-8"
    )
    (row,) = study(folder)
    assert row["failure"] == EDITED_WHILE_IT_FLEW
    assert not list((folder / "mine" / "runs" / row["id"]).glob("*/"))
    (folder / "laws.py").write_text("GAIN = 2\n", encoding="utf-8")
    assert [row["standing"] for row in study(folder, "--dry-run")] == ["to fly"]
