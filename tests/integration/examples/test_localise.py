"""The mission as a user flies it: for some seconds, twice, with three UA and two emitters, with equal digests."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from lostlink.reading.run import Run, load_run

ROOT = Path(__file__).parents[3]
SCENARIO = ROOT / "examples" / "localise" / "localise.yaml"
pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


def scenario(slot: int) -> str:
    """The shipped one with a third UA and a second emitter, for 40 s."""
    tree = yaml.safe_load(SCENARIO.read_text())
    first, second, beacon = tree["nodes"]
    tree["duration_s"] = 60
    tree["ports"] = {"zenoh": 0, "first_slot": slot}
    for ua in (first, second):
        ua["agent"]["class"] = f"{ROOT / 'examples' / 'localise' / 'agent.py'}:Localise"
        ua["agent"]["options"] |= {"emitters": {"beacon": 20, "other": 15}, "until_s": 40}
    third = yaml.safe_load(yaml.safe_dump(second)) | {"id": 2, "home": {"north_m": -150, "east_m": 0}}
    third["agent"]["options"]["altitude_m"] = 60
    other = beacon | {"id": "other", "place": {"north_m": -100, "east_m": -150}, "power_dbm": 15}
    return yaml.safe_dump(tree | {"nodes": [first, second, third, beacon, other]})


def flown(folder: Path, slot: int) -> Run:
    folder.mkdir()
    (folder / "mission.yaml").write_text(scenario(slot))
    command = [
        sys.executable,
        "-m",
        "lostlink.cli.main",
        "run",
        str(folder / "mission.yaml"),
        "--out",
        str(folder / "out"),
    ]
    done = subprocess.run([*command, "--quiet"], cwd=ROOT, capture_output=True, text=True, timeout=400)
    assert done.returncode == 0, done.stdout + done.stderr
    [run] = (folder / "out").iterdir()
    return load_run(run)


def test_the_mission_flies_and_repeats(tmp_path: Path, free_slot: Callable[[int], int]) -> None:
    first, second = (flown(tmp_path / name, free_slot(3)) for name in ("first", "second"))
    assert first.ending == "done"
    assert first.digest == second.digest
    for emitter in ("beacon", "other"):
        told = first.agent_values(f"estimate.{emitter}")
        assert set(told["node"]) == {"0", "1", "2"}
        for _, rows in told.groupby("node"):
            assert rows["readings"].iloc[0] == 0
            assert rows["readings"].iloc[-1] > 30
    own = first.agent_values("reading").groupby(["node", "emitter"]).size()
    at_the_end = told.groupby("node")["readings"].last()
    assert all(at_the_end[node] > own[node, "other"] for node in ("0", "1", "2")), (
        "nobody heard of others' readings"
    )
    assert len(first.agent_values("plan")) >= 6
