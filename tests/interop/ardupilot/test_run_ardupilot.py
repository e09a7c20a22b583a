"""The default scenario, flown by real ArduCopters."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

pytestmark = [pytest.mark.ardupilot, pytest.mark.timeout(400)]


def test_separation_flown_by_real_arducopters_agrees_with_the_model(
    arducopter: Path, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    command = [sys.executable, "-m", "lostlink.cli.main", "run", "--autopilot", "ardupilot", "--json"]
    command += ["--radio", "moon2020"]  # a packet of which says nothing of the next: bins are judged
    command += ["--ardupilot-dir", str(arducopter.parent), "--out", str(tmp_path)]
    command += ["--first-slot", str(free_slot(2)), "--zenoh-port", "0"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=380)
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert (summary["ending"], summary["autopilot"]) == ("done", "ardupilot")
    assert summary["bins_judged"] >= 50
    assert summary["bins_within"] >= 0.95 * summary["bins_judged"]
    for link in summary["links"]:
        assert link["sent"] == link["delivered"] + sum(link["lost"].values()) > 2000


def test_parameters_that_an_arducopter_does_not_have_are_told(
    arducopter: Path, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    command = [sys.executable, "-m", "lostlink.cli.main", "run", "--autopilot", "ardupilot", "--json"]
    command += ["--ardupilot-dir", str(arducopter.parent), "--out", str(tmp_path), "--duration", "4"]
    command += ["--first-slot", str(free_slot(2)), "--no-zenoh", "--speed", "max", "--no-figure"]
    command += ["--set", "parameters={NO_SUCH: 1, FS_GCS_ENABLE: 1}"]
    command += ["--set", "nodes.1.parameters={CHUTE_ALT_MIN: 20, RTL_ALT: 3000}"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr
    why = "this version has none, or its group is switched off"
    assert json.loads(done.stdout)["warnings"] == [
        f"UA 0: its ArduPilot lists no parameter NO_SUCH; {why}",
        f"UA 1: its ArduPilot lists no parameter CHUTE_ALT_MIN, NO_SUCH; {why}",
    ]
