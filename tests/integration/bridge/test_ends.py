"""However a run ends, in one process as in many: what is said, what is kept, and that nothing is left."""

from __future__ import annotations

import json
import resource
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import psutil
import pytest

from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.reader import read_columns
from bridge.record.tables.truth import TRUTH
from tests.integration.bridge.conftest import STILL, Run, StartRun

LONG_S = 36_000.0
"""Sim time that no run of these reaches."""
TICK_NS = 50_000_000
BEFORE = "lostlink: interrupted before the run began"
slow = partial(pytest.param, marks=pytest.mark.slow)
both = pytest.mark.parametrize("processes", ["one", "many"])


def ports_of(run: Run) -> list[tuple[socket.SocketKind, int]]:
    tcp = [base + 10 * (run.slot + i) for base in (5760, 6760) for i in range(2)]
    tcp += [int(run.endpoint.rsplit(":", 1)[1])] if run.endpoint else []
    udp = [9002 + 10 * (run.slot + i) for i in range(2)]
    return [(socket.SOCK_STREAM, p) for p in tcp] + [(socket.SOCK_DGRAM, p) for p in udp]


def assert_nothing_is_left(run: Run, children: Sequence[psutil.Process]) -> None:
    """No process, no port, no password."""
    _, alive = psutil.wait_procs(children, timeout=0)
    assert not alive
    for kind, port in ports_of(run):
        with socket.socket(type=kind) as probe:
            if kind == socket.SOCK_STREAM:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(("127.0.0.1", port))
    assert not (run.directory / "secrets").exists()


def assert_tables_are_whole(run: Run) -> int:
    """No packet and no tick is missing up to the last; gives how many ticks there are, 0 if no record was begun."""
    assert not list(run.directory.glob("*.partial"))
    if not TRUTH.parquet_path(run.directory).exists():
        assert run.summary["sim_duration_s"] == 0.0
        assert run.summary["links"] == []
        return 0
    packets = read_columns(run.directory, DELIVERIES, ("tx", "seq"))
    for node in ("0", "1"):
        mine = packets["seq"][packets["tx"] == node]
        assert (mine == np.arange(len(mine))).all()
    ticks = np.unique(read_columns(run.directory, TRUTH, ("tick_ns",))["tick_ns"])
    assert (ticks == np.arange(len(ticks)) * TICK_NS).all()
    return len(ticks)


@both
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("after_s", [0.05, 0.3, 0.5, 1.0, 2.0, slow(5.0), slow(20.0)])
def test_a_signal_ends_a_run_at_any_time(
    start_run: StartRun, processes: str, number: signal.Signals, after_s: float
) -> None:
    run = start_run(processes=processes, duration_s=LONG_S)
    wait_until_it_is_heard(run, number)
    time.sleep(after_s)  # that moment, not a wait for something
    children = run.children()
    assert run.stop(number) < 5.0
    said = run.output.decode()
    assert run.process.returncode == 128 + number, said
    assert "Traceback" not in said
    if not run.out.exists():
        assert said.splitlines() == [BEFORE]
        return
    assert said.splitlines()[-1].startswith("interrupted: "), said
    assert (run.summary["ending"], run.summary["error"]) == ("interrupted", None)
    assert run.summary["sim_duration_s"] == pytest.approx(
        max(0, assert_tables_are_whole(run) - 1) * 0.05, abs=0.051
    )
    assert_nothing_is_left(run, children)


EARLY = """\
import os, signal
from lostlink.cli import entry
from lostlink.flight.flight import Flight

fly = Flight.fly

def interrupted(self, *arguments, **more):
    os.kill(os.getpid(), signal.SIGTERM)
    return fly(self, *arguments, **more)

Flight.fly = interrupted
entry.main()
"""


def test_a_signal_just_before_the_flight_ends_it_with_a_summary(
    tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    """The run's directory is there already, and no event loop yet."""
    command = [sys.executable, "-c", EARLY, "run", "--out", str(tmp_path), "--first-slot", str(free_slot(2))]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 128 + signal.SIGTERM, done.stderr
    assert done.stdout.splitlines()[-1].startswith("interrupted: no link was recorded")
    (run,) = tmp_path.iterdir()
    assert json.loads((run / "summary.json").read_text())["ending"] == "interrupted"


def wait_until_it_is_heard(run: Run, number: signal.Signals) -> None:
    """Wait until the command's own first line has run: before that, Python has its way."""
    status = Path(f"/proc/{run.process.pid}/status")
    until = time.monotonic() + 10.0
    while time.monotonic() < until:
        caught = next(line for line in status.read_text().splitlines() if line.startswith("SigCgt"))
        if int(caught.split()[1], 16) >> (signal.SIGTERM - 1) & 1:
            return
    raise AssertionError(f"nobody takes {number.name}")


@both
@pytest.mark.parametrize("moment", ["starts flight dynamics", "waits for the autopilots", "sim time"])
def test_a_signal_ends_everything_at_any_stage(start_run: StartRun, processes: str, moment: str) -> None:
    run = start_run(processes=processes, duration_s=LONG_S)
    run.wait_for(moment)
    children = run.children()
    assert run.stop(signal.SIGTERM) < 5.0
    assert run.process.returncode == 128 + signal.SIGTERM, run.output.decode()
    assert run.summary["ending"] == "interrupted"
    assert_tables_are_whole(run)
    assert_nothing_is_left(run, children)


OWN = """\
import time
from bridge.agents import Agent


class Mine(Agent):
    def __init__(self, *arguments):
        super().__init__(*arguments)
        while self.options["does"] == "build":
            time.sleep(0.01)

    async def fly(self):
        await self.sleep(3600)

    def on_tick(self, sim_time_ns):
        super().on_tick(sim_time_ns)
        if sim_time_ns < 2_000_000_000:
            return
        if self.options["does"] == "raise":
            raise ArithmeticError("a mistake of mine")
        self.ua.report("computes", done=False)
        while True:
            time.sleep(0.01)
"""


def with_an_agent_that(folder: Path, does: str) -> str:
    """A scenario whose UA 1 has an agent of its own."""
    (folder / "mine.py").write_text(OWN)
    own = f"{{{{type: own, class: {folder}/mine.py:Mine, options: {{{{does: {does}}}}}}}}}"
    head, _, tail = STILL.rpartition("{{type: still}}")
    return head + own + tail


@both
def test_an_agent_that_raises_ends_the_run_with_its_tick(
    start_run: StartRun, tmp_path: Path, processes: str
) -> None:
    run = start_run(scenario=with_an_agent_that(tmp_path, "raise"), processes=processes)
    run.wait_for("sim time")
    children = run.children()
    assert run.finish() == 1
    told = "the agent of UA 1 failed: ArithmeticError at a tick: a mistake of mine"
    assert run.summary["error"] == f"{told}; its log is {run.directory}/logs/node-1.log"
    assert f"lostlink: {told}" in run.output.decode()
    assert "Traceback" not in run.output.decode()
    assert (run.summary["ending"], run.summary["sim_duration_s"]) == ("failed", 2.0)
    assert assert_tables_are_whole(run) == 41
    assert_nothing_is_left(run, children)


@both
def test_a_run_with_an_agent_that_blocks_can_be_ended(
    start_run: StartRun, tmp_path: Path, processes: str
) -> None:
    run = start_run(scenario=with_an_agent_that(tmp_path, "block"), processes=processes)
    run.wait_for("no tick for")
    children = run.children()
    assert run.stop(signal.SIGINT) < 10.0
    assert run.process.returncode == 128 + signal.SIGINT
    assert (run.summary["ending"], run.summary["error"]) == ("interrupted", None)
    assert assert_tables_are_whole(run) in (40, 41)
    assert (
        "the agent of node 1 did not end"
        in (run.directory / "logs" / f"{host_of(processes)}.log").read_text()
    )
    assert_nothing_is_left(run, children)


@both
def test_a_run_whose_agent_is_never_built_can_be_ended(
    start_run: StartRun, tmp_path: Path, processes: str
) -> None:
    run = start_run(scenario=with_an_agent_that(tmp_path, "build"), processes=processes)
    run.wait_for("starts flight dynamics")
    log = run.directory / "logs" / f"{host_of(processes)}.log"
    wait_for_text(log, "MAVLink of UA 0" if processes == "one" else "")
    children = run.children()
    assert run.stop(signal.SIGINT) < 8.0
    assert run.process.returncode == 128 + signal.SIGINT, run.output.decode()
    assert (run.summary["ending"], run.summary["error"]) == ("interrupted", None)
    assert_nothing_is_left(run, children)


def wait_for_text(file: Path, text: str) -> None:
    deadline = time.monotonic() + 20.0
    while not (file.exists() and text in file.read_text()):
        assert time.monotonic() < deadline, f"no {text!r} in {file}"
        time.sleep(0.05)


def host_of(processes: str) -> str:
    """The process that has UA 1's agent, of two cores or more."""
    return "fleet" if processes == "one" else "host-1"


@pytest.mark.slow
@both
def test_an_agent_that_blocks_is_given_up(start_run: StartRun, tmp_path: Path, processes: str) -> None:
    run = start_run(scenario=with_an_agent_that(tmp_path, "block"), processes=processes)
    run.wait_for("no tick for")
    children = run.children()
    assert run.finish(150.0) == 1
    assert run.summary["ending"] == "failed"
    assert run.summary["error"].startswith("sim time has stood at ")
    assert f"{run.directory}/logs/{host_of(processes)}.log: " in run.summary["error"]
    assert_tables_are_whole(run)
    assert_nothing_is_left(run, children)


@both
def test_a_full_disk_ends_the_run_and_says_so(start_run: StartRun, processes: str) -> None:
    """No file of the run may have more than so many bytes, which its tables and streams soon want."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, limits[1]))
    try:
        run = start_run("--no-mcap", processes=processes, duration_s=LONG_S)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    run.wait_for("sim time")
    children = run.children()
    assert run.finish() == 1, run.output.decode()
    said = run.output.decode()
    assert "File too large" in said
    assert "Traceback" not in said
    assert run.summary["ending"] == "failed"
    assert "File too large" in run.summary["error"]
    assert assert_tables_are_whole(run) > 100
    assert_nothing_is_left(run, children)


@pytest.mark.parametrize(
    ("processes", "victim", "name", "hosts"),
    [
        ("one", "bridge.program.process", "fleet", "auto"),
        ("many", "bridge.radio.process", "router", "auto"),
        ("many", "bridge.host.process", "host-0", "auto"),
        ("many", "standin --sysid 2", "autopilot-1", "per-ua"),
        ("many", "standin --sysid 1", "autopilots-0", "1"),
    ],
)
def test_a_killed_process_ends_the_run_by_name_and_log(
    start_run: StartRun, processes: str, victim: str, name: str, hosts: str
) -> None:
    run = start_run("--set", f"hosts={hosts}", processes=processes, duration_s=LONG_S)
    run.wait_for("sim time")
    children = run.children()
    run.child(victim).kill()
    assert run.finish(15.0) == 1
    text = run.output.decode()
    killed = f"{name} was ended by SIGKILL"
    assert killed in text
    assert str(run.directory / "logs" / f"{name}.log") in text
    assert "Traceback" not in text
    assert run.summary["ending"] == "failed"
    assert run.summary["error"] in text
    assert [each["text"].split(";")[0] for each in run.summary["events"] if each["kind"] == "died"] == [
        killed
    ]
    assert any(f"{killed} at" in reason for reason in run.summary["may_not_repeat"])
    if name in ("router", "fleet"):
        assert run.summary["verdict"].startswith("broke off: no link was recorded")
    assert_tables_are_whole(run)
    assert_nothing_is_left(run, children)


@pytest.mark.parametrize(
    ("processes", "victim", "name", "ending"),
    [
        ("many", "bridge.host.process", "host-0", "interrupted"),
        slow("many", "bridge.radio.process", "router", "failed"),
        slow("one", "bridge.program.process", "fleet", "failed"),
    ],
)
def test_a_process_that_does_not_end_is_killed_and_the_summary_tells_it(
    start_run: StartRun, processes: str, victim: str, name: str, ending: str
) -> None:
    """Whoever has the record gets more time; without it the run has failed."""
    run = start_run(processes=processes, duration_s=LONG_S)
    run.wait_for("sim time")
    children = run.children()
    run.child(victim).send_signal(signal.SIGSTOP)
    run.stop(signal.SIGINT)
    assert run.summary["ending"] == ending
    events = [event["text"] for event in run.summary["events"] if event["kind"] == "killed"]
    assert any(text.startswith(f"{name} did not end in time and was killed; its log is") for text in events)
    assert any(reason.startswith(f"{name} did not end in time") for reason in run.summary["may_not_repeat"])
    assert_nothing_is_left(run, children)


@pytest.mark.parametrize(("processes", "hosts", "count"), [("one", "auto", 1), ("many", "per-ua", 6)])
def test_a_killed_supervisor_leaves_no_process(
    start_run: StartRun, processes: str, hosts: str, count: int
) -> None:
    run = start_run("--set", f"hosts={hosts}", processes=processes, duration_s=LONG_S)
    run.wait_for("sim time")
    children = run.children()
    assert len(children) == count
    run.process.kill()
    _, alive = psutil.wait_procs(children, timeout=10)
    assert not alive


@pytest.mark.slow
@pytest.mark.ardupilot
@pytest.mark.usefixtures("arducopter")
@both
def test_a_killed_ardupilot_ends_the_run_by_name(start_run: StartRun, processes: str) -> None:
    run = start_run("--autopilot", "ardupilot", processes=processes)
    run.wait_for("sim time   ", timeout_s=90.0)
    children = run.children()
    run.child("arducopter").kill()
    assert run.finish(20.0) == 1
    assert "autopilot-0 was ended by SIGKILL" in run.output.decode()
    assert run.summary["error"].startswith("autopilot-0 was ended by SIGKILL; its log is ")
    assert run.summary["ending"] == "failed"
    assert_tables_are_whole(run)
    assert_nothing_is_left(run, children)
