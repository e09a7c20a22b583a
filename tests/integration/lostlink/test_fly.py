"""`lostlink.fly` and `load_run` as a script uses them: real runs."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import pytest
import yaml

from bridge.run.directory import RunDirectory
from lostlink import FleetError, ScenarioError, fly, load_run
from tests.integration.bridge.conftest import STILL


@pytest.fixture
def scenario(free_slot: Callable[[int], int]) -> dict[str, Any]:
    content: dict[str, Any] = yaml.safe_load(STILL.format(speed="max", duration_s=3.0, slot=free_slot(2)))
    return content


def children() -> list[str]:
    """What runs below us, but for what tests here may have started once: for multiprocessing, and to fork from."""
    running = []
    for child in psutil.Process().children():
        with suppress(psutil.NoSuchProcess):  # over; of another test's, perhaps
            running.append(" ".join(child.cmdline()))
    kept = ("multiprocessing.resource_tracker", "tests.warm")
    return [command for command in running if not any(name in command for name in kept)]


def test_a_mapping_is_flown_and_read_back(tmp_path: Path, scenario: dict[str, Any]) -> None:
    result = fly(scenario, seed=4, directory=tmp_path, changes={"tick_rate_hz": 10})
    assert (result.ending, result.ok, result.error) == ("duration", True, None)
    assert result.path.parent == tmp_path
    run = result.run
    assert (run.scenario.seed, run.scenario.tick_rate_hz, run.digest) == (4, 10, result.summary["digest"])
    assert len(run.truth) == 2 * 31
    (one, other) = result.summary["links"]
    assert run.links[["sent", "delivered"]].to_numpy().tolist() == [
        [link["sent"], link["delivered"]] for link in (one, other)
    ]
    assert run.truth.position_north_m[run.truth.node == "1"].mean() == pytest.approx(410.0, abs=0.1)
    assert load_run(result.path).verdict == result.verdict
    assert not RunDirectory(result.path).is_live
    assert children() == []


@pytest.mark.slow
def test_a_run_whose_ports_are_in_use_moves_if_it_may(tmp_path: Path, scenario: dict[str, Any]) -> None:
    slot = scenario["ports"]["first_slot"]
    with socket.create_server(("127.0.0.1", 6760 + 10 * slot)):
        with pytest.raises(FleetError, match=f"TCP port {6760 + 10 * slot} .* is in use"):
            fly(scenario, directory=tmp_path, duration_s=0.2)
        result = fly(scenario, first_slot="auto", directory=tmp_path, duration_s=0.2)
    assert result.run.scenario.ports.first_slot not in (slot - 1, slot)


@pytest.mark.slow
async def test_a_notebook_flies_from_its_event_loop_and_from_a_thread(
    tmp_path: Path, scenario: dict[str, Any]
) -> None:
    first = fly(scenario, duration_s=0.5, directory=tmp_path)
    second = await asyncio.to_thread(fly, scenario, duration_s=0.5, directory=tmp_path)
    assert first.summary["digest"] == second.summary["digest"]


@pytest.mark.skipif(
    (3, 12) <= sys.version_info < (3, 12, 3), reason="Python starts no thread then (gh-113964)"
)
@pytest.mark.parametrize("processes", ["one", pytest.param("many", marks=pytest.mark.slow)])
def test_a_thread_flies_on_when_the_main_thread_has_ended(
    tmp_path: Path, scenario: dict[str, Any], processes: str
) -> None:
    script = (
        "import sys, threading, yaml\nfrom lostlink import fly\n"
        "scenario = yaml.safe_load(sys.argv[1])\n"
        "def work():\n    threading.main_thread().join()\n"
        "    print(fly(scenario, duration_s=0.5, directory=sys.argv[2]).ending)\n"
        "threading.Thread(target=work).start()\n"
    )
    content = yaml.safe_dump(scenario | {"processes": processes})
    command = [sys.executable, "-c", script, content, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)
    assert (done.returncode, done.stdout) == (0, "duration\n"), done.stderr


def test_mistakes_are_told_before_anything_starts(tmp_path: Path, scenario: dict[str, Any]) -> None:
    with pytest.raises(ScenarioError, match="no scenario of that name"):
        fly("nowhere", directory=tmp_path)
    with pytest.raises(ScenarioError, match="speed"):
        fly(scenario, speed=-1.0, directory=tmp_path)
    with pytest.raises(FleetError, match="arducopter"):
        fly(scenario, autopilot="ardupilot", ardupilot_dir=tmp_path, directory=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_agents_import_what_the_program_can(
    tmp_path: Path, scenario: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As from a script's folder, or pytest's `pythonpath`: no environment variable has these."""
    (tmp_path / "flown_by_path.py").write_text(
        "from lostlink import Agent\n\nclass Short(Agent):\n    async def fly(self):\n        await self.sleep(0.1)\n",
        encoding="utf-8",
    )
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])
    for node in scenario["nodes"]:
        node["agent"] = {"type": "own", "class": "flown_by_path:Short"}
    result = fly(scenario, directory=tmp_path / "runs", changes={"mcap.write": False, "figure": False})
    assert (result.error, result.ending) == (None, "done")


@pytest.mark.slow
def test_ctrl_c_ends_the_run_with_its_record(tmp_path: Path, scenario: dict[str, Any]) -> None:
    script = (
        "import signal, yaml, sys\nfrom lostlink import fly\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # whoever started the tests may ignore it
        "try:\n    fly(yaml.safe_load(sys.argv[1]), speed=1.0, duration_s=100.0, directory=sys.argv[2], quiet=False)\n"
        "except KeyboardInterrupt:\n    print('interrupted', flush=True)\n"
    )
    command = [sys.executable, "-c", script, yaml.safe_dump(scenario), str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        next(line for line in process.stdout if line.startswith("sim time"))
        processes = psutil.Process(process.pid).children(recursive=True)
        assert processes
        os.kill(process.pid, signal.SIGINT)
        assert "interrupted" in process.stdout.read()
        assert process.wait(30.0) == 0
    _, alive = psutil.wait_procs(processes, timeout=5.0)
    assert alive == []
    (directory,) = tmp_path.iterdir()
    run = load_run(directory)
    assert run.ending == "interrupted"
    assert len(run.truth) > 0


@pytest.mark.slow
def test_an_exception_in_the_waiting_thread_leaves_nothing_behind(
    tmp_path: Path, scenario: dict[str, Any]
) -> None:
    class Stop(Exception):
        pass

    def interrupt(*_: object) -> None:
        raise Stop

    old = signal.signal(signal.SIGUSR1, interrupt)
    timer = threading.Timer(2.0, lambda: os.kill(os.getpid(), signal.SIGUSR1))
    timer.start()
    try:
        with pytest.raises(Stop):
            fly(scenario, speed=1.0, duration_s=100.0, directory=tmp_path)
    finally:
        timer.join()
        signal.signal(signal.SIGUSR1, old)
    assert children() == []
    (directory,) = tmp_path.iterdir()
    assert load_run(directory).ending == "interrupted"
