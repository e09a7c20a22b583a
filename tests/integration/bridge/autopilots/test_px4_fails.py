"""Runs whose PX4 ends or cannot be had: told, and no process stays. A script takes the place of a real PX4."""

from __future__ import annotations

import os
import signal
import socket
import sys
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from tests.integration.bridge.conftest import STILL, StartRun
from tests.px4_played import build

ROOT = Path(__file__).parents[4]


@pytest.mark.slow
def test_a_px4_that_ends_at_once_ends_the_run_with_its_last_words(
    tmp_path: Path, start_run: StartRun
) -> None:
    place = build(tmp_path / "px4", 'echo "ERROR [init] no such airframe"; exit 3')
    run = start_run("--autopilot", "px4", "--px4-dir", str(place))
    assert run.finish() == 1
    told = run.output.decode()
    assert "ended with status 3" in told
    assert "ERROR [init] no such airframe" in told


def test_a_px4_that_never_connects_leaves_nothing_when_the_run_is_ended(
    tmp_path: Path, start_run: StartRun
) -> None:
    tells = tmp_path / "tells"
    os.mkfifo(tells)
    run = start_run(
        "--autopilot", "px4", "--px4-dir", str(build(tmp_path / "px4", f"echo $$ > {tells}; exec sleep 1000"))
    )
    px4 = psutil.Process(int(tells.read_text().split()[0]))
    run.stop(signal.SIGINT)
    assert not px4.is_running()


def test_a_port_of_its_simulator_that_is_taken_is_told(
    tmp_path: Path, start_run: StartRun, free_slot: Callable[[int], int]
) -> None:
    slot = free_slot(2)
    place = build(tmp_path / "px4", "exit 1")
    with socket.create_server(("127.0.0.1", 4560 + slot)):
        run = start_run("--autopilot", "px4", "--px4-dir", str(place), "--first-slot", str(slot))
        assert run.finish() == 2
    assert f"TCP port {4560 + slot} (flight dynamics of UA 0's PX4) is in use" in run.output.decode()


@pytest.mark.slow
def test_a_px4_out_of_lockstep_is_told_and_why_the_run_may_not_repeat(
    tmp_path: Path, start_run: StartRun
) -> None:
    """UA 1's is, as one built for hardware in the loop; it runs on. UA 0's flies, and has no real-time threads."""
    play = f"{sys.executable} -m tests.px4_played $((4560 + $2)) 3 1000000"
    which = f'case "$OLDPWD" in *autopilot-1) {play} unlocked; exec sleep 1000;; *) exec {play};; esac'
    place = build(tmp_path / "px4", f"cd {ROOT}; {which}")
    scenario = STILL.replace("radio:", "fdm: {{stall_timeout_s: 1}}\nradio:")
    run = start_run("--autopilot", "px4", "--px4-dir", str(place), scenario=scenario, duration_s=1.0)
    assert run.finish() == 0, run.output.decode()
    summary = run.summary
    kinds = [event["kind"] for event in summary["events"] if event["node"] == "1"]
    assert kinds[:3] == ["joined", "refused", "stalled"]
    reasons = summary["may_not_repeat"]
    assert any("UA 1 was refused: its autopilot is not in lockstep" in reason for reason in reasons)
    assert any("UA 0: its PX4 may not have real-time threads" in reason for reason in reasons)
    assert any("UA 0: PX4's start script goes on when" in reason for reason in reasons), "as ever"
