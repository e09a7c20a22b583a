"""The examples do what they say: each is checked, and flown in short form."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.reader import read_columns
from bridge.record.tables.schema import NED
from bridge.record.tables.truth import TRUTH
from bridge.scenario.file import SCENARIOS
from lostlink.cli.flying.check import check
from tests.integration.bridge.conftest import Run, StartRun
from tests.warm import run_lostlink

EXAMPLES = Path(__file__).parents[4] / "examples"
SHIPPED = Path(str(SCENARIOS))
FOLDERS = ("agents", "ground_nodes", "scenarios")
MISSIONS = ("consensus", "localise", "relay_placement")
"""Flown in short form in tests/integration/examples."""
FILES = [
    *(file for folder in FOLDERS for file in sorted((EXAMPLES / folder).glob("*.yaml"))),
    *(EXAMPLES / name / f"{name}.yaml" for name in MISSIONS),
    EXAMPLES / "two_autopilots" / "two_autopilots.yaml",
    SHIPPED / "separation.yaml",
    SHIPPED / "mixed.yaml",
]
SHORT_S = {
    "beyond_range": 14,
    "gusts": 14,
    "ground_station": 15,
    "heavy_and_light": 14,
    "leader_follower": 14,
    "own_radio": 14,
    "relay": 20,
    "ring": 14,
    "separation": 14,
    "turn_back": 14,
    "wander": 14,
    "wifi": 14,
}
"""Sim time that each is flown for with the stand-in: the first packets, and most of a climb."""
WHOLE, REAL, BESIDE = {"acceptance"}, {"fixed_wing", "mixed"}, {"beside"}
BOTH = {"two_autopilots"}
"""Of PX4 and ArduPilot: flown in tests/interop/px4/test_run_px4.py."""
Fly = Callable[..., Path]


def test_there_are_a_dozen_and_each_has_a_test() -> None:
    names = {file.stem for file in FILES}
    assert len(names) >= 12
    assert names == {*SHORT_S, *WHOLE, *REAL, *BESIDE, *BOTH, *MISSIONS}


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_each_is_right_and_offers_no_more_than_its_radio_carries(file: Path) -> None:
    done = CliRunner().invoke(check, [str(file), "--json"])
    assert done.exit_code == 0, done.output
    plan = json.loads(done.output)
    assert plan["description"]
    assert plan["warnings"] == []


@pytest.fixture
def fly(tmp_path: Path, free_slot: Callable[[int], int]) -> Fly:
    """Fly a scenario with options and see that it ends with a status; returns the run directory."""

    def fly(name: str, *options: str, status: int = 0) -> Path:
        file = next(file for file in FILES if file.stem == name)
        slot = free_slot(6)
        command = [
            "run",
            str(file),
            "--out",
            str(tmp_path),
            "--first-slot",
            str(slot),
            "--zenoh-port",
            "0",
        ]
        done = run_lostlink(*command, *options, timeout=300)
        assert done.returncode == status, done.stdout + done.stderr
        (run,) = tmp_path.iterdir()
        return run

    return fly


def summary_of(run: Path) -> dict[str, Any]:
    summary: dict[str, Any] = json.loads((run / "summary.json").read_text())
    return summary


def lines_of(run: Path, node: str, name: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (run / "agents" / node / f"{name}.jsonl").read_text().splitlines()]


def heights_m(run: Path, node: str) -> list[float]:
    columns = read_columns(run, TRUTH, ("node", "position_down_m"))
    return (-columns["position_down_m"][columns["node"] == node]).tolist()


@pytest.mark.slow
@pytest.mark.timeout(400)
@pytest.mark.parametrize("name", sorted({*SHORT_S} - {"relay", "ground_station"}))
def test_it_flies(fly: Fly, name: str) -> None:
    run = fly(name, "--duration", str(SHORT_S[name]), "--quiet")
    summary = summary_of(run)
    assert summary["ending"] == "duration"
    assert all(expectation["passed"] for expectation in summary["expectations"])
    assert max(heights_m(run, "0")) > 5.0


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_what_is_relayed_comes_by_way_of_the_middle(fly: Fly) -> None:
    run = fly("relay", "--duration", str(SHORT_S["relay"]), "--quiet")
    heard = lines_of(run, "0", "heard")
    assert {(line["origin"], line["by"]) for line in heard} == {("2", "1")}
    assert {line["delay_ns"] for line in heard} == {100_000_000}  # a tick to the relay, and one from it


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_the_ground_station_keeps_what_it_hears(fly: Fly) -> None:
    run = fly("ground_station", "--duration", str(SHORT_S["ground_station"]), "--quiet")
    lines = lines_of(run, "gcs", "telemetry")
    assert {line["ua"] for line in lines} == {"0", "1", "2"}
    assert set(read_columns(run, DELIVERIES, ("tx",))["tx"]) == {"0", "1", "2"}


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.timeout(400)
def test_an_acceptance_run_is_accepted_and_a_stricter_one_is_not(fly: Fly, tmp_path: Path) -> None:
    """The same record, judged twice: as flown, and by what it cannot have shown."""
    run = fly("acceptance", "--quiet")
    assert [row["passed"] for row in summary_of(run)["expectations"]] == [True] * 9
    stricter = tmp_path / "stricter.yaml"
    base = EXAMPLES / "scenarios" / "acceptance.yaml"
    stricter.write_text(f"extends: {base}\nexpectations: [{{type: separation, at_least_m: 150}}]\n")
    done = run_lostlink("judge", str(run), str(stricter))
    assert done.returncode == 3
    truth = read_columns(run, TRUTH)
    position_ned_m = np.column_stack([truth[f"position_{axis}_m"] for axis in NED])
    places = {node: position_ned_m[truth["node"] == node] for node in ("0", "1")}
    nearest_m = np.linalg.norm(places["0"] - places["1"], axis=1).min()
    assert done.stdout == f"FAILED: separation of UA: wanted at least 150 m, found {nearest_m:.4g} m\n"


@pytest.mark.slow
def test_a_run_that_is_not_as_expected_ends_with_status_3(fly: Fly) -> None:
    expectations = "[{type: delivery, at_most: 0.5}, {type: ending, ending: duration}]"
    options = ("--duration", "1", "--set", f"expectations={expectations}", "--json")
    summary = summary_of(fly("separation", *options, status=3))
    assert [(row["passed"], row["found"]) for row in summary["expectations"]] == [
        (
            False,
            sum(link["delivered"] for link in summary["links"])
            / sum(link["sent"] for link in summary["links"]),
        ),
        (True, "duration"),
    ]
    assert summary["outcome"] == "fail"
    assert summary["verdict"].startswith("fail: 1 of 2 expectations not met: delivery all to all; ")


@pytest.mark.slow
@pytest.mark.ardupilot
@pytest.mark.timeout(400)
@pytest.mark.parametrize("name", sorted(REAL))
def test_those_with_real_autopilots_fly(fly: Fly, name: str, arduplane: Path, arducopter: Path) -> None:
    run = fly(name, "--duration", "60", "--quiet", "--ardupilot-dir", str(arduplane.parent))
    assert summary_of(run)["autopilot"] == "ardupilot"


@pytest.mark.slow
def test_a_program_beside_the_run_transmits(start_run: StartRun) -> None:
    ports = "{{zenoh: 0, first_slot: {slot}}}"
    run: Run = start_run(scenario=f"extends: {EXAMPLES / 'ground_nodes' / 'beside.yaml'}\nports: {ports}\n")
    run.wait_for("stays on the ground")
    command = [sys.executable, str(EXAMPLES / "ground_nodes" / "beside.py"), str(run.directory)]
    done = subprocess.run(
        command, input="one\ntwo\n", capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stdout.startswith("packet 0 is on the air"), done.stderr
    assert "packet 1 is on the air" in done.stdout
    run.stop(signal.SIGINT)
    (link,) = [link for link in run.summary["links"] if link["tx"] == "probe"]
    assert (link["rx"], link["sent"]) == ("0", 2)
