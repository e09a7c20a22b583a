"""A recorded run is flown again, with what came from outside and without those who sent it."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mav

from bridge.agents import connect_ua
from lostlink import load_run
from tests.integration.bridge.conftest import STILL, Run, StartRun
from tests.integration.bridge.mavlink.mission import mission_items, upload
from tests.warm import run_lostlink

ITEMS = 12


def ground_station(run: Run) -> None:
    """Change mode, set a parameter, upload a mission; each is seen to be done."""
    client = mavutil.mavlink_connection(
        f"tcp:127.0.0.1:{6760 + 10 * (run.slot + 1)}", source_system=255, source_component=190
    )
    client.mav.set_mode_send(2, mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, 4)
    assert client.recv_match(
        type="HEARTBEAT", condition="HEARTBEAT.custom_mode==4", blocking=True, timeout=20
    )
    client.mav.param_set_send(2, 1, b"RTL_ALT", 2500.0, mav.MAV_PARAM_TYPE_REAL32)
    assert client.recv_match(
        type="PARAM_VALUE", condition="PARAM_VALUE.param_value==2500", blocking=True, timeout=20
    )
    upload(client, mission_items(ITEMS))
    client.close()


def refly(run: Path, tmp_path: Path, slot: int, *more: str) -> subprocess.CompletedProcess[str]:
    out = tmp_path / "again"
    ports = ("--zenoh-port", "0", "--first-slot", str(slot))
    return run_lostlink("refly", run, "--out", out, *ports, *more, timeout=280)


@pytest.fixture
def visited(start_run: StartRun) -> Run:
    """A run at which a ground station was."""
    run = start_run(speed="3", duration_s=20.0)
    run.wait_for("sim time")
    ground_station(run)
    assert run.finish() == 0, run.output.decode()
    return run


@pytest.mark.parametrize("processes", ["one", pytest.param("many", marks=pytest.mark.long)])
@pytest.mark.slow
def test_run_with_a_ground_station_is_flown_again_without_it(
    processes: str, visited: Run, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    done = refly(visited.directory, tmp_path, free_slot(2), "--json", "--processes", processes)
    assert done.returncode == 0, done.stderr
    content = json.loads(done.stdout)
    assert content["difference"] is None
    assert content["summary"]["digests"] == visited.summary["digests"]
    names = [json.loads(line).get("name") for line in inputs_of(visited).read_text().splitlines()]
    assert names.count("MISSION_ITEM_INT") >= ITEMS
    assert {"SET_MODE", "PARAM_SET", "MISSION_COUNT"} <= set(names)


def inputs_of(run: Run) -> Path:
    return run.directory / "inputs" / "1.jsonl"


def altered(run: Run, tmp_path: Path) -> tuple[Path, int]:
    """A copy of the run in which the ground station set another parameter value, and the tick of it."""
    copy = tmp_path / "altered"
    shutil.copytree(run.directory, copy)
    file = copy / "inputs" / "1.jsonl"
    lines = file.read_text().splitlines()
    number = next(n for n, line in enumerate(lines) if json.loads(line).get("name") == "PARAM_SET")
    item = json.loads(lines[number])
    sender = mav.MAVLink(None, 255, 190)
    sender.seq = bytes.fromhex(item["hex"])[4]
    frame = mav.MAVLink_param_set_message(2, 1, b"RTL_ALT", 2600.0, mav.MAV_PARAM_TYPE_REAL32).pack(sender)
    lines[number] = json.dumps(item | {"hex": frame.hex()})
    file.write_text("\n".join(lines) + "\n")
    return copy, int(item["tick_ns"])


@pytest.mark.slow
def test_an_input_altered_by_hand_gives_the_first_difference_and_status_1(
    visited: Run, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    copy, tick_ns = altered(visited, tmp_path)
    done = refly(copy, tmp_path, free_slot(2), "--json")
    assert done.returncode == 1, done.stderr
    difference = json.loads(done.stdout)["difference"]
    assert difference["tick_ns"] == tick_ns
    assert (difference["node"], difference["stream"]) == ("1", "mavlink/1/to_autopilot")
    assert "2500" in difference["a"]
    assert "2600" in difference["b"]


@pytest.mark.slow
def test_a_record_of_another_version_says_so(
    start_run: StartRun, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    run = start_run(duration_s=2.0)
    assert run.finish() == 0, run.output.decode()
    file = run.directory / "provenance.json"
    content = json.loads(file.read_text())
    content["lostlink"] = "0.0.1"
    content["autopilots"]["1"] = {"source": "ardupilot", "version": "V4.6", "sha256": "ab" * 32}
    file.write_text(json.dumps(content))
    done = refly(run.directory, tmp_path, free_slot(2))
    assert done.returncode == 0, done.stderr
    assert "lostlink 0.0.1 made the record" in done.stderr
    assert "UA 1" in done.stderr
    assert "identical" in done.stdout


@pytest.mark.slow
def test_the_binaries_of_the_record_are_flown_again(
    start_run: StartRun, tmp_path: Path, free_slot: Callable[[int], int], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = start_run(duration_s=1.0)
    assert run.finish() == 0, run.output.decode()
    scenario, made = run.directory / "scenario.yaml", run.directory / "provenance.json"
    scenario.write_text(scenario.read_text().replace("autopilot: standin", "autopilot: ardupilot"))
    binary = tmp_path / "arducopter"
    binary.write_text("#!/bin/sh\nexit 7\n")
    binary.chmod(0o755)
    origin = {"source": "ardupilot", "sha256": "ab" * 32, "path": str(binary)}
    content = json.loads(made.read_text())
    made.write_text(json.dumps(content | {"autopilots": {"0": origin, "1": origin}}))
    monkeypatch.delenv("ARDUPILOT_HOME", raising=False)
    done = refly(run.directory, tmp_path, free_slot(2))
    assert "ended with status 7" in done.stderr


@pytest.mark.slow
@pytest.mark.long
def test_a_shipped_agent_yields_to_an_operator(
    start_run: StartRun, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    out = "{{type: out_and_back, altitude_m: 20, distance_m: 900, speed_mps: 10}}"
    scenario = STILL.replace("agent: {{type: still}}}}\n  - {{id: 1", f"agent: {out}}}}}\n  - {{{{id: 1")
    run = start_run(scenario=scenario, duration_s=1.0)
    assert run.finish() == 0, run.output.decode()
    file = run.directory / "scenario.yaml"
    file.write_text(file.read_text().replace("duration_s: 1.0", "duration_s: 300.0"))
    (run.directory / "inputs").mkdir()
    rtl = {"tick_ns": 30_000_000_000, "kind": "command", "verb": "rtl"}
    (run.directory / "inputs" / "0.jsonl").write_text(json.dumps(rtl) + "\n")
    done = refly(run.directory, tmp_path, free_slot(2), "--json")
    summary = json.loads(done.stdout)["summary"]
    assert (summary["ending"], summary["error"], summary["unfinished"]) == ("done", None, [])
    assert summary["sim_duration_s"] > 40.0
    (again,) = (tmp_path / "again").iterdir()
    north_m = load_run(again).truth.query("node == '0'").position_north_m
    assert north_m.max() > 50.0
    assert abs(north_m.iloc[-1]) < 5.0


@pytest.mark.slow
async def test_an_operators_command_is_repeated(
    start_run: StartRun, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    run = start_run(speed="6", duration_s=30.0)
    run.wait_for("sim time")
    async with connect_ua(run.directory, "1") as ua:
        await ua.wait_for(lambda state: state.mode != "", timeout_s=20)
        await ua.set_mode("GUIDED")
        await ua.wait_for(lambda state: state.ready_to_arm, timeout_s=60)
        await ua.arm()
        await ua.takeoff(5.0)
    assert run.finish() == 0, run.output.decode()
    verbs = [json.loads(line).get("verb") for line in inputs_of(run).read_text().splitlines()]
    assert verbs == ["mode", "arm", "takeoff"]
    done = refly(run.directory, tmp_path, free_slot(2))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "identical" in done.stdout


@pytest.mark.slow
@pytest.mark.long
def test_an_interrupted_run_is_flown_again_to_its_last_whole_tick(
    start_run: StartRun, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    run = start_run(speed="5")
    run.wait_for("sim time")
    run.wait_for(" in the last ")  # the second line of progress, after ten seconds
    run.stop(signal.SIGINT)
    done = refly(run.directory, tmp_path, free_slot(2))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "identical" in done.stdout
    assert "last whole tick" in done.stdout
