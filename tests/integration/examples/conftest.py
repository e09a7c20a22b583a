"""Missions flown as a user flies them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from lostlink.reading.run import Run, load_run
from tests.warm import run_lostlink

ROOT = Path(__file__).parents[3]
FlyMission = Callable[..., Run]


@pytest.fixture
def fly_mission(tmp_path: Path, free_slot: Callable[[int], int]) -> FlyMission:
    """Fly a mission of examples/ with some settings; gives its record."""

    def fly(mission: str, name: str, settings: dict[str, object]) -> Run:
        file = ROOT / "examples" / mission / f"{mission}.yaml"
        ports = {"ports.zenoh": 0, "ports.first_slot": free_slot(5)}
        command = ["run", str(file), "--out", str(tmp_path / name), "--quiet"]
        for key, value in (settings | ports).items():
            command += ["--set", f"{key}={value}"]
        done = run_lostlink(*command, timeout=400)
        assert done.returncode == 0, done.stdout + done.stderr
        [run] = (tmp_path / name).iterdir()
        return load_run(run)

    return fly
