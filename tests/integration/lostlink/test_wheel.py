"""The wheel by itself: installed beside its dependencies, without the clone, in an empty folder."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Callable
from pathlib import Path

import click
import pytest

from bridge.scenario.file import SCENARIOS

ROOT = Path(__file__).parents[3]
pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]


@pytest.fixture
def lostlink(tmp_path: Path) -> Callable[..., str]:
    """Run the installed command in an empty folder; returns what it printed."""
    there = tmp_path / "venv"
    venv.create(there, symlinks=True)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    build = [*pip, "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(tmp_path), str(ROOT)]
    subprocess.run(build, check=True, timeout=200)
    (wheel,) = tmp_path.glob("*.whl")
    place = Path(sysconfig.get_path("purelib", vars={"base": str(there)}))
    subprocess.run(
        [*pip, "install", "--no-deps", "--no-index", "--target", str(place), str(wheel)], check=True
    )
    for package in Path(click.__file__).parents[1].iterdir():
        if (
            package.suffix != ".pth"
            and "lostlink" not in package.name
            and not (place / package.name).exists()
        ):
            (place / package.name).symlink_to(package)  # no .pth: one of them leads to the clone
    empty = tmp_path / "empty"
    empty.mkdir()
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}

    def run(*arguments: str) -> str:
        command = [str(there / "bin" / "python"), "-m", "lostlink", *arguments]
        done = subprocess.run(
            command, cwd=empty, env=environment, capture_output=True, text=True, timeout=100, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return run


def test_an_installed_wheel_flies(
    lostlink: Callable[..., str], tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    for scenario in sorted(Path(str(SCENARIOS)).glob("*.yaml")):
        lostlink("check", scenario.stem, "--json")
    ports = ("--first-slot", str(free_slot(2)), "--zenoh-port", "0")
    summary = json.loads(lostlink("run", "--duration", "3", "--json", *ports))
    assert summary["outcome"] == "pass"
    (run,) = (tmp_path / "empty" / "runs").iterdir()
    assert (run / "deliveries.parquet").exists()
