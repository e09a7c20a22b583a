"""Runs with a real PX4."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytestmark = [pytest.mark.px4, pytest.mark.timeout(900)]


def fly(out: Path, slot: int, *options: str) -> dict[str, Any]:
    """The summary of a run of `separation` with PX4."""
    command = [sys.executable, "-m", "lostlink.cli.main", "run", "--autopilot", "px4", "--json"]
    command += ["--out", str(out), "--first-slot", str(slot), "--zenoh-port", "0", *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=850, check=False)
    assert done.returncode == 0, done.stderr
    summary: dict[str, Any] = json.loads(done.stdout)
    return summary


@pytest.mark.slow
def test_separation_flown_by_real_px4_agrees_with_the_model(
    px4: Path, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    summary = fly(tmp_path, free_slot(2), "--radio", "moon2020", "--px4-dir", str(px4.parents[1]))
    assert (summary["ending"], summary["autopilot"]) == ("done", "px4")
    assert summary["bins_judged"] >= 50
    assert summary["bins_within"] >= 0.95 * summary["bins_judged"]
    (run,) = tmp_path.iterdir()
    assert len(list(run.glob("autopilot-*/log/*/*.ulg"))) == 2, "PX4's logs are kept"


def test_two_flights_of_a_real_px4_have_the_same_bytes(
    px4: Path, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    first, second = (fly(tmp_path / name, free_slot(2), "--duration", "25") for name in ("first", "second"))
    if first["may_not_repeat"]:
        pytest.skip(f"may not repeat here: {first['may_not_repeat'][0]}")
    assert first["digests"] == second["digests"]
