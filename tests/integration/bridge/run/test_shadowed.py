"""Files of the user's that have the names of our packages break no run, and are told where they would."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.integration.bridge.conftest import LOSTLINK

NAMES = ("channel", "bridge", "fdm", "aps")
SAFE = [LOSTLINK[0], "-P", *LOSTLINK[1:]]
"""As the installed command is started: without the working directory on its path."""
AGENT = """
import sibling
from bridge.agents import Agent
from fdm.model.geodesy import geodetic_from_ned

class Own(Agent):
    async def fly(self):
        self.ua.report(sibling.WORD)
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with files of our packages' names, a scenario, and an agent beside its sibling."""
    for name in NAMES:
        (tmp_path / f"{name}.py").write_text(f"raise SystemExit('{name}.py of the user ran')\n")
    (tmp_path / "agent.py").write_text(AGENT)
    (tmp_path / "sibling.py").write_text("WORD = 'beside'\n")
    agent = "{type: own, class: agent.py:Own, has_task: false}"
    text = f"extends: separation\nname: mine\nnodes:\n  - {{id: 0, agent: {agent}}}\n"
    (tmp_path / "mine.yaml").write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def flown(slot: int, *arguments: str) -> dict[str, Any]:
    command = [
        *SAFE,
        "run",
        "mine.yaml",
        "--json",
        "--duration",
        "1",
        "--speed",
        "max",
        "--no-figure",
        "--no-mcap",
    ]
    command += ["--set", "ports.zenoh=0", "--first-slot", str(slot), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.stdout, done.stderr
    summary: dict[str, Any] = json.loads(done.stdout)
    return summary


WORKERS = ("--processes", "many", "--set", "fdm.workers=2", "--set", "fdm.coupling=parallel")


@pytest.mark.parametrize("arguments", [("--processes", "one"), WORKERS], ids=["one", "many"])
@pytest.mark.slow
def test_a_run_is_not_broken(
    folder: Path, arguments: tuple[str, ...], free_slot: Callable[[int], int]
) -> None:
    assert flown(free_slot(24), *arguments)["ending"] == "duration"


@pytest.mark.slow
def test_a_study_and_the_view_are_not_broken(folder: Path, free_slot: Callable[[int], int]) -> None:
    study = (
        "schema: 1\nname: mine\nscenario: mine.yaml\nseeds: {first: 1, count: 2}\nvary: {duration_s: [1]}\n"
    )
    (folder / "study.yaml").write_text(study)
    command = [*SAFE, "study", "study.yaml", "--lanes", "1"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    summary = flown(free_slot(24), "--view", "--view-port", "0")
    assert summary["ending"] == "duration", summary["error"]
    (view_log,) = folder.glob("runs/*/logs/view.log")
    assert "of the user ran" not in view_log.read_text()


@pytest.mark.parametrize("name", NAMES)
def test_import_says_what_hides_a_package(folder: Path, name: str) -> None:
    for other in NAMES:
        if other != name:
            (folder / f"{other}.py").unlink()
    done = subprocess.run(
        [sys.executable, "-c", "import lostlink"], capture_output=True, text=True, check=False
    )
    assert (
        f"ImportError: {folder.resolve()}/{name}.py hides lostlink's package {name}: rename it" in done.stderr
    )
