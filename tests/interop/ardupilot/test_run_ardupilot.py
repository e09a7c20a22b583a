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
