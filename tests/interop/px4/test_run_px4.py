"""Runs with a real PX4."""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from fdm.exchange.px4.watched import WHILE_IT_STARTS
from lostlink.reading.run import load_run

pytestmark = [pytest.mark.px4, pytest.mark.timeout(900)]

ROOT = Path(__file__).parents[3]
BESIDE = ROOT / "examples" / "two_autopilots" / "two_autopilots.yaml"
CORNERS, HEIGHT_M = ((40, 0), (40, 40), (0, 40)), 20.0
"""Of its mission: north and east of home, metres."""


def fly(out: Path, slot: int, *options: str) -> dict[str, Any]:
    """The summary of a run, by default of `separation` and with PX4."""
    command = [sys.executable, "-m", "lostlink.cli.main", "run", *options, "--json"]
    command += ["--out", str(out), "--first-slot", str(slot), "--zenoh-port", "0"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=850, check=False)
    assert done.returncode == 0, done.stderr
    summary: dict[str, Any] = json.loads(done.stdout)
    return summary


def track(run: Path, node: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """North and east of its home (n, 2), and height above it, metres."""
    truth = load_run(run).truth
    mine = truth[truth["node"].astype(str) == str(node)]
    ned_m = mine[["position_north_m", "position_east_m", "position_down_m"]].to_numpy(float)
    return ned_m[:, :2] - ned_m[0, :2], ned_m[0, 2] - ned_m[:, 2]


@pytest.mark.slow
def test_separation_flown_by_real_px4_agrees_with_the_model(
    px4: Path, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    options = ("--autopilot", "px4", "--radio", "moon2020", "--px4-dir", str(px4.parents[1]))
    summary = fly(tmp_path, free_slot(2), *options)
    assert (summary["ending"], summary["autopilot"]) == ("done", "px4")
    assert summary["bins_judged"] >= 50
    assert summary["bins_within"] >= 0.95 * summary["bins_judged"]
    (run,) = tmp_path.iterdir()
    for node in ("0", "1"):
        (log,) = summary["autopilot_logs"][node]
        assert (run / log).read_bytes().startswith(b"ULog"), "as PX4's documentation of the format has it"


@pytest.mark.slow
@pytest.mark.usefixtures("px4")
@pytest.mark.parametrize(
    ("scenario", "ending"),
    [("mixed", "done"), (str(ROOT / "examples" / "localise" / "localise.yaml"), "done")],
)
def test_px4_flies_a_plane_beside_a_copter_and_finds_an_emitter(
    scenario: str, ending: str, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    summary = fly(tmp_path, free_slot(2), scenario, "--autopilot", "px4")
    assert (summary["ending"], summary["error"]) == (ending, None)


@pytest.mark.slow
@pytest.mark.parametrize("beside", ["px4", "ardupilot"])
def test_a_mission_and_the_return_beside_another_autopilot(
    beside: str, request: pytest.FixtureRequest, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    request.getfixturevalue("px4")
    if beside == "ardupilot":
        request.getfixturevalue("arducopter")
    content = yaml.safe_load(BESIDE.read_text(encoding="utf-8"))
    content["nodes"][1]["autopilot"] = beside
    for node in content["nodes"]:
        node["agent"]["class"] = str(BESIDE.parent / "agent.py:MissionAndReturn")
    scenario = tmp_path / "beside.yaml"
    scenario.write_text(yaml.safe_dump(content), encoding="utf-8")
    summary = fly(tmp_path / "runs", free_slot(2), str(scenario))
    assert summary["ending"] == "done"
    (run,) = (tmp_path / "runs").iterdir()
    for node in (0, 1):
        places_m, heights_m = track(run, node)
        for corner in CORNERS:
            assert np.hypot(*(places_m - corner).T).min() < 3.0
        assert heights_m.max() >= HEIGHT_M - 1.0
        assert heights_m[-1] < 0.5, "it has landed"
        assert np.hypot(*places_m[-1]) < 3.0, "at home"
    assert "0" in summary["autopilot_logs"], summary["autopilot_logs"]


PLANE = """
schema: 1
name: landing
autopilot: px4
speed: max
duration_s: 300
origin: {lat_deg: 47.3977, lon_deg: 8.5456, alt_amsl_m: 488}
radio: perfect
nodes: [{id: 0, airframe: aerosonde, agent: {type: own, class: "lands.py:Lands"}}]
"""
LANDS = """
from lostlink import Agent


class Lands(Agent):
    async def fly(self):
        await self.ua.wait_for(lambda state: state.ready_to_arm)
        items = (("NAV_TAKEOFF", 300, 0, 60), ("NAV_WAYPOINT", 400, 500, 60), ("NAV_WAYPOINT", -700, 500, 50),
                 ("NAV_WAYPOINT", -700, 0, 50), ("NAV_LAND", 0, 0, 0))
        mission = []
        for command, north_m, east_m, height_m in items:
            place = self.ua.frames.earth_from_fleet((north_m, east_m, 0))
            params = [0, 0, 0, None, place.lat_deg, place.lon_deg, height_m]
            mission.append({"command": command, "params": params})
        await self.ua.missions.upload(mission)
        await self.ua.arm()
        await self.ua.missions.fly()
"""


@pytest.mark.slow
@pytest.mark.usefixtures("px4")
def test_a_plane_lands_where_its_mission_says(tmp_path: Path, free_slot: Callable[[int], int]) -> None:
    (tmp_path / "landing.yaml").write_text(PLANE, encoding="utf-8")
    (tmp_path / "lands.py").write_text(LANDS, encoding="utf-8")
    summary = fly(tmp_path / "runs", free_slot(1), str(tmp_path / "landing.yaml"))
    assert (summary["ending"], summary["warnings"]) == ("done", [])
    (run,) = (tmp_path / "runs").iterdir()
    places_m, heights_m = track(run, 0)
    assert heights_m[-1] < 0.1
    assert np.hypot(*places_m[heights_m > 5.0][-1]) < 150.0


@pytest.mark.usefixtures("px4")
def test_of_three_flights_of_a_real_px4_two_have_the_same_bytes(
    tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    """Each tells that it may be the third one, and nothing else."""
    options = ("--autopilot", "px4", "--duration", "25")
    flights = [fly(tmp_path / str(number), free_slot(2), *options) for number in range(3)]
    reasons = {reason for flight in flights for reason in flight["may_not_repeat"]}
    if any("real-time threads" in reason for reason in reasons):
        pytest.skip("PX4 may not have real-time threads here: no two flights are alike")
    assert reasons == {f"UA {ua}: {WHILE_IT_STARTS}" for ua in (0, 1)}
    digests = [json.dumps(flight["digests"], sort_keys=True) for flight in flights]
    assert Counter(digests).most_common(1)[0][1] >= 2
