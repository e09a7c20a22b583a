"""`lostlink doctor` tells what is here, what is taken and what to do about it."""

from __future__ import annotations

import json
import socket
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.integration.bridge.conftest import STILL
from tests.warm import run_lostlink

MANY = "processes: many\n"


def doctor(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return run_lostlink("doctor", *arguments, cwd=cwd, timeout=60)


def test_all_is_well_where_the_ports_are_free(tmp_path: Path, free_slot: Callable[[int], int]) -> None:
    slot = free_slot(2)
    (tmp_path / "arducopter").write_text("#!/bin/sh\n")
    (tmp_path / "arducopter").chmod(0o755)
    (tmp_path / "still.yaml").write_text(STILL.format(speed="max", duration_s=1, slot=0) + MANY)
    options = ("--first-slot", str(slot), "--ardupilot-dir", str(tmp_path), "--json")
    done = doctor("still.yaml", *options, cwd=tmp_path)
    assert done.returncode == 0, done.stdout
    report = json.loads(done.stdout)
    assert report["ok"]
    assert report["ports_taken"] == []
    assert None not in report["packages"].values()
    assert report["autopilots"]["arducopter"] == str(tmp_path / "arducopter")
    assert any(str(9002 + 10 * slot) in port for port in report["ports"])
    assert report["joined"] == "many processes, joined by Zenoh"


@pytest.mark.parametrize("as_json", [False, True])
def test_taken_port_is_named_with_its_owner_and_how_to_move(
    tmp_path: Path, free_slot: Callable[[int], int], as_json: bool
) -> None:
    slot = free_slot(2)
    (tmp_path / "still.yaml").write_text(STILL.format(speed="max", duration_s=1, slot=slot) + MANY)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 9002 + 10 * slot))
        done = doctor("still.yaml", *(["--json"] if as_json else []), cwd=tmp_path)
    assert done.returncode == 1
    told = " ".join(json.loads(done.stdout)["ports_taken"]) if as_json else done.stdout
    assert f"UDP port {9002 + 10 * slot} (flight dynamics of UA 0) is in use" in told
    assert "--first-slot" in told


def test_a_port_that_one_process_does_not_need_may_be_taken(
    tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    slot = free_slot(2)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 9002 + 10 * slot))
        done = doctor("--first-slot", str(slot), cwd=tmp_path)
    assert done.returncode == 0, done.stdout
    assert "Ports (one process, without Zenoh beside it)" in done.stdout
    assert f"TCP port {6760 + 10 * slot} (MAVLink server of UA 0)" in done.stdout
    assert "flight dynamics" not in done.stdout


def test_mistake_in_the_scenario_is_told(tmp_path: Path) -> None:
    done = doctor("nowhere.yaml", cwd=tmp_path)
    assert done.returncode == 2
    assert "nowhere.yaml" in done.stderr
    assert "Traceback" not in done.stderr
