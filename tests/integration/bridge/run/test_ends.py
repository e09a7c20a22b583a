"""However a run ends, in one process as in many: what is said, what is kept, and that nothing is left."""

from __future__ import annotations

import json
import os
import pty
import re
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import psutil
import pytest

from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.reader import read_columns
from bridge.record.tables.truth import TRUTH
from bridge.run.directory import RunDirectory
from tests.integration.bridge.conftest import LOSTLINK, STILL, Run, StartRun
from tests.warm import run_lostlink

LONG_S = 36_000.0
"""Sim time that no run of these reaches."""
ENDS_S = 10.0
"""Less than a part that hangs is given (``ROUTER_GRACE_S``, which begins after the graces of the others)."""
TICK_NS = 50_000_000
BEFORE = "lostlink: interrupted before the run began"
slow = partial(pytest.param, marks=pytest.mark.slow)
both = pytest.mark.parametrize("processes", ["one", "many"])


IN_SHORT = {(0.05, signal.SIGINT, "one"), (0.5, signal.SIGTERM, "one"), (1.0, signal.SIGINT, "many")}
IN_CI = {
    (0.3, signal.SIGTERM, "one"),
    (0.5, signal.SIGINT, "one"),
    (1.0, signal.SIGTERM, "one"),
    (2.0, signal.SIGINT, "one"),
    (0.3, signal.SIGINT, "many"),
    (2.0, signal.SIGTERM, "many"),
}
"""Of the moments at which a signal comes: each at least once, each signal and way to run at several."""


def moments() -> Iterator[object]:
    """After how long, s, which signal comes to which kind of run."""
    numbers, kinds = (signal.SIGINT, signal.SIGTERM), ("one", "many")
    for case in product((0.05, 0.3, 0.5, 1.0, 2.0, 5.0, 20.0), numbers, kinds):
        is_slow = case in IN_CI or case[:2] == (5.0, signal.SIGINT)
        mark = [] if case in IN_SHORT else [pytest.mark.slow] if is_slow else [pytest.mark.long]
        yield pytest.param(*case, marks=mark)


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


@pytest.mark.parametrize(("after_s", "number", "processes"), [*moments()])
def test_a_signal_ends_a_run_at_any_time(
    start_run: StartRun, processes: str, number: signal.Signals, after_s: float
) -> None:
    run = start_run(processes=processes, duration_s=LONG_S, anew=True)
    wait_until_it_is_heard(run, number)
    time.sleep(after_s)  # that moment, not a wait for something
    children = run.children()
    assert run.stop(number) < ENDS_S
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
from bridge.run.directory import RunDirectory
from lostlink.flight.flight import Flight

doing = {doing}

def interrupted(*arguments, **more):
    {doing} = doing
    os.kill(os.getpid(), signal.SIGTERM)
    return doing(*arguments, **more)

{doing} = interrupted
"""


@pytest.mark.parametrize(
    "doing",
    ["RunDirectory.__init__", pytest.param("Flight.__init__", marks=pytest.mark.long), "Flight.fly"],
)
def test_a_signal_just_before_the_flight_ends_it_with_a_summary(
    tmp_path: Path, free_slot: Callable[[int], int], doing: str
) -> None:
    """The run's directory is there already, and no event loop yet."""
    options = ["--out", str(tmp_path), "--first-slot", str(free_slot(2))]
    done = run_lostlink("run", *options, timeout=60, first=EARLY.format(doing=doing))
    assert done.returncode == 128 + signal.SIGTERM, done.stderr
    assert done.stdout.splitlines()[-1].startswith("interrupted: no link was recorded")
    (run,) = tmp_path.iterdir()
    assert json.loads((run / "summary.json").read_text())["ending"] == "interrupted"


LATE = """\
import os, signal
from lostlink.flight.flight import Flight

late = Flight.{step}

def interrupted(self):
    os.kill(os.getpid(), signal.SIGINT)
    return late(self)

Flight.{step} = interrupted
"""


@pytest.mark.parametrize(
    ("step", "doing"), [("_finish_tables", "writes its tables"), slow("_write_mcap", "writes run.mcap")]
)
def test_a_signal_while_the_record_is_written_is_told_with_what_to_do(
    tmp_path: Path, free_slot: Callable[[int], int], step: str, doing: str
) -> None:
    options = ["--out", str(tmp_path), "--first-slot", str(free_slot(2)), "--duration", "0.5", "--no-figure"]
    done = run_lostlink("run", *options, timeout=60, first=LATE.format(step=step))
    (run,) = tmp_path.iterdir()
    assert done.returncode == 128 + signal.SIGINT
    export = f"lostlink export {run} --parquet --mcap"
    assert done.stderr.startswith(f"lostlink: interrupted while it {doing}; `{export}` writes "), done.stderr
    assert "Traceback" not in done.stderr
    run_lostlink(*export.split()[1:], check=True, timeout=60)
    assert DELIVERIES.parquet_path(run).exists()
    assert (run / "run.mcap").exists()


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
@pytest.mark.parametrize(
    "moment", [slow("starts flight dynamics"), "waits for the autopilots", slow("sim time")]
)
def test_a_signal_ends_everything_at_any_stage(start_run: StartRun, processes: str, moment: str) -> None:
    run = start_run(processes=processes, duration_s=LONG_S)
    run.wait_for(moment)
    children = run.children()
    assert run.stop(signal.SIGTERM) < ENDS_S
    assert run.process.returncode == 128 + signal.SIGTERM, run.output.decode()
    assert run.summary["ending"] == "interrupted"
    assert_tables_are_whole(run)
    assert_nothing_is_left(run, children)


@pytest.mark.slow
def test_a_signal_ends_workers_that_have_yet_to_begin(start_run: StartRun) -> None:
    """They hold the ports of their UA."""
    run = start_run("--set", "fdm.workers=2", processes="many", duration_s=LONG_S)
    children: list[psutil.Process] = []
    while run.process.poll() is None and sum(is_worker(child) for child in children) < 2:
        with suppress(psutil.NoSuchProcess):
            children = run.children()
    assert run.stop(signal.SIGTERM) < ENDS_S
    assert run.process.returncode == 128 + signal.SIGTERM, run.output.decode()
    assert_nothing_is_left(run, children)


def is_worker(process: psutil.Process) -> bool:
    with suppress(psutil.NoSuchProcess):
        return "fdm.workers.worker" in process.cmdline()
    return False


ON_A_TERMINAL = """\
import fcntl, os, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
"""


@pytest.mark.slow
def test_a_closed_terminal_ends_a_run_in_order(tmp_path: Path, free_slot: Callable[[int], int]) -> None:
    options = ["--out", str(tmp_path), "--first-slot", str(free_slot(2)), "--duration", str(LONG_S)]
    command = [LOSTLINK[0], "-c", ON_A_TERMINAL, *LOSTLINK[1:], "run", *options]
    ours, its = pty.openpty()
    with subprocess.Popen(command, stdin=its, stdout=its, stderr=its, start_new_session=True) as run:
        os.close(its)
        said = b""
        while b"flies" not in said:
            said += os.read(ours, 65536)
        children = psutil.Process(run.pid).children(recursive=True)
        os.close(ours)
        assert run.wait(20.0) == 128 + signal.SIGHUP
    assert children
    assert not [child for child in children if child.is_running()]
    (directory,) = tmp_path.iterdir()
    assert json.loads((directory / "summary.json").read_text())["ending"] == "interrupted"


@pytest.mark.slow
@pytest.mark.parametrize("begin", ["run ", "sim time"])
def test_a_run_that_nobody_reads_any_more_ends_in_order(
    tmp_path: Path, free_slot: Callable[[int], int], begin: str
) -> None:
    options = ["--out", str(tmp_path), "--first-slot", str(free_slot(2)), "--duration", str(LONG_S)]
    with subprocess.Popen(
        [*LOSTLINK, "run", *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as run:
        assert run.stdout is not None
        assert run.stderr is not None
        while not (line := run.stdout.readline()).startswith(begin.encode()):
            assert line, run.stderr.read()
        run.stdout.close()
        assert run.wait(30.0) == 128 + signal.SIGPIPE
        assert run.stderr.read() == b""
    (directory,) = tmp_path.iterdir()
    assert json.loads((directory / "summary.json").read_text())["ending"] == "interrupted"


TAKEN_LATER = """\
import bridge.fleet.preflight.slots as slots

slots.conflicts = lambda uses, held: []  # the port is taken by the time that it is bound
"""


@pytest.mark.parametrize("processes", ["one", pytest.param("many", marks=pytest.mark.long)])
def test_a_port_that_is_taken_after_the_look_at_it_is_no_start(
    tmp_path: Path, free_slot: Callable[[int], int], processes: str
) -> None:
    slot = free_slot(2)
    options = [f"--out={tmp_path}", f"--first-slot={slot}", f"--processes={processes}"]
    with socket.create_server(("127.0.0.1", 6760 + 10 * slot)):
        done = run_lostlink("run", *options, timeout=60, first=TAKEN_LATER)
    assert done.returncode == 2
    assert f"TCP port {6760 + 10 * slot} (MAVLink server of UA 0) is in use by python" in done.stderr
    (directory,) = tmp_path.iterdir()
    assert f"TCP port {6760 + 10 * slot}" in json.loads((directory / "summary.json").read_text())["error"]


def test_a_run_that_may_move_flies_at_free_ports(tmp_path: Path, free_slot: Callable[[int], int]) -> None:
    slot = free_slot(2)
    options = [f"--out={tmp_path}", "--first-slot=auto", f"--set=ports.first_slot={slot}", "--duration=0.5"]
    with socket.create_server(("127.0.0.1", 6760 + 10 * slot)):
        done = run_lostlink("run", *options, "--no-figure", "--no-mcap", "--quiet", timeout=60)
    assert done.returncode == 0, done.stderr
    (directory,) = tmp_path.iterdir()
    moved = RunDirectory(directory).scenario.ports
    assert moved.first_slot not in (slot - 1, slot)
    assert f"it moves to --first-slot {moved.first_slot}, " in done.stderr


OWN = """\
import asyncio
import time

from bridge.agents import Agent


class Mine(Agent):
    def __init__(self, *arguments):
        super().__init__(*arguments)
        if self.options["does"] == "construct":
            self.altitude_m = self.options["altitud"]
        while self.options["does"] == "build":
            time.sleep(0.01)

    async def fly(self):
        await self.sleep(2 if self.options["does"] == "spin" else 3600)
        while True:
            await asyncio.sleep(0)

    def on_tick(self, sim_time_ns):
        super().on_tick(sim_time_ns)
        if sim_time_ns < 2_000_000_000 or self.options["does"] == "spin":
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
    told = "the agent of UA 1 failed: ArithmeticError at a tick: a mistake of mine (mine.py:25)"
    assert run.summary["error"] == f"{told}; its log is logs/node-1.log"
    assert f"lostlink: {told}; its log is {run.directory}/logs/node-1.log" in run.output.decode()
    assert "Traceback" not in run.output.decode()
    assert (run.summary["ending"], run.summary["sim_duration_s"]) == ("failed", 2.0)
    assert assert_tables_are_whole(run) == 41
    assert_nothing_is_left(run, children)


@both
def test_an_agent_that_cannot_be_made_ends_the_run_by_name(
    start_run: StartRun, tmp_path: Path, processes: str
) -> None:
    run = start_run(scenario=with_an_agent_that(tmp_path, "construct"), processes=processes)
    assert run.finish() == 1
    told = "the agent of UA 1 failed: KeyError in its constructor: 'altitud' (mine.py:11)"
    log = run.directory / "logs" / "node-1.log"
    assert run.summary["error"] == f"{told}; its log is logs/node-1.log"
    assert run.summary["may_not_repeat"] == []
    assert f"lostlink: {told}" in run.output.decode()
    assert "broke off: " in run.output.decode()
    for never in ("Traceback", "may not repeat", "hosted_node"):
        assert never not in run.output.decode()
    assert 'self.options["altitud"]' in log.read_text()


def assert_the_radio_ended_it(run: Run, processes: str, told: str) -> None:
    """In words: by the process that the radio is in."""
    name = "fleet" if processes == "one" else "router"
    assert run.summary["error"].startswith(f"{name} ended with status 1: {told}; its log is logs/{name}.log")
    assert f": {told}; its log is {run.directory}/logs/{name}.log" in run.output.decode()
    assert "Traceback" not in run.output.decode()


LAWS = """
import numpy as np
from channel.variant import Variant


class Blinks(Variant):
    mean_loss: float = 0.5

    def loss_at(self, words, times_ns):
        return np.where(times_ns == 2_000_000_000, np.nan, times_ns // 10**9 % 2)
"""


@pytest.mark.parametrize("processes", ["one", slow("many")])
def test_a_model_of_ones_own_that_gives_nonsense_ends_the_run_by_its_class(
    start_run: StartRun, tmp_path: Path, processes: str
) -> None:
    (tmp_path / "laws.py").write_text(LAWS)
    bursts = f"radio.bursts={{class: {tmp_path}/laws.py:Blinks}}"
    run = start_run("--set", bursts, processes=processes, duration_s=60.0)
    assert run.finish() == 1
    told = "laws.py:Blinks.loss_at gave nan at sim_time_ns 2000000000: has to be from 0 to 1"
    assert_the_radio_ended_it(run, processes, told)


AIR = """
from channel.access.media.airtime import AirTime
from channel.access.settings.base import Serial


class Impatient(AirTime):
    def _wake(self, node):
        super()._wake(node)
        if self.agenda.now_ns > 2_000_000_000:
            raise ZeroDivisionError("mine")


class ImpatientMedium(Serial):
    def open(self, surroundings):
        timings, hearing = self.timings(surroundings), self.hearing(surroundings)
        return Impatient(surroundings.world, timings, self.queue.limits, hearing)
"""


@pytest.mark.parametrize("processes", ["one", slow("many")])
def test_a_medium_of_ones_own_that_raises_ends_the_run_by_its_class_and_line(
    start_run: StartRun, tmp_path: Path, processes: str
) -> None:
    (tmp_path / "air.py").write_text(AIR)
    medium = f"radio.medium={{class: {tmp_path}/air.py:ImpatientMedium}}"
    run = start_run("--set", medium, processes=processes, duration_s=60.0)
    assert run.finish() == 1
    told = f"the medium Impatient: {tmp_path}/air.py:10: ZeroDivisionError: mine"
    assert_the_radio_ended_it(run, processes, told)


@pytest.mark.slow
@pytest.mark.parametrize("processes", ["one", pytest.param("many", marks=pytest.mark.long)])
def test_a_run_with_an_agent_that_blocks_can_be_ended(
    start_run: StartRun, tmp_path: Path, processes: str
) -> None:
    run = start_run(scenario=with_an_agent_that(tmp_path, "block"), processes=processes)
    run.wait_for("no tick for")
    assert re.search(r"sim time +2\.00 s, [^;]*; no tick for", run.output.decode())
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


FAULTS = """\
import os, sys

if {{"run", "bridge.physics.process", "standin"}} & set(sys.orig_argv):
    import itertools, math
    from fdm.model.jsbsim_model import JsbsimModel
    from standin.autopilot import Autopilot

    init, built, step, steps = JsbsimModel.__init__, [], Autopilot.step, itertools.count()

    def faulty_init(self, *arguments):
        init(self, *arguments)
        built.append(self)
        if len(built) == 2:  # that of UA 1
            frames, exact = itertools.count(), self.sense
            self.sense = lambda: exact() if next(frames) < 1200 else faulty(exact())

    def faulty(exact):
        if "{fault}" == "raises":
            raise ArithmeticError("a mistake of the model")
        return (math.nan, *exact[1:])

    def faulty_step(self):
        if next(steps) == 3000:
            raise ArithmeticError("a mistake of its own")
        return step(self)

    if "{fault}" == "stand-in":
        Autopilot.step = faulty_step
    else:
        JsbsimModel.__init__ = faulty_init
"""
"""In a `sitecustomize.py`, which every Python process that finds it imports at its start."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("processes", "fault", "error"),
    [
        slow("one", "stand-in", "the stand-in of UA 0 cannot go on: ArithmeticError: a mistake of its own"),
        # Each has it at the same step of its own: which of the two is sooner there is a matter of wall time.
        slow("many", "stand-in", " cannot go on: ArithmeticError: a mistake of its own"),
        slow("one", "raises", "ArithmeticError: a mistake of the model"),
        slow("many", "raises", "ArithmeticError: a mistake of the model"),
        ("one", "diverges", "the flight model of UA 1 diverged; its last state is in {logs}/fleet.log"),
        slow(
            "many", "diverges", "the flight model of UA 1 diverged; its last state is in {logs}/physics.log"
        ),
    ],
)
def test_what_flies_and_fails_ends_the_run_with_a_whole_record(
    start_run: StartRun,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    processes: str,
    fault: str,
    error: str,
) -> None:
    (tmp_path / "sitecustomize.py").write_text(FAULTS.format(fault=fault))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    with_tasks = STILL.replace("type: still", "type: out_and_back, altitude_m: 5, distance_m: 50")
    run = start_run("--no-mcap", scenario=with_tasks, processes=processes, duration_s=60.0)
    run.wait_for("sim time")
    children = run.children()
    assert run.finish() == 1
    said = run.output.decode()
    assert error.format(logs="logs") in run.summary["error"]
    assert error.format(logs=run.directory / "logs") in said
    assert "Traceback" not in said
    assert run.summary["ending"] == "failed"
    assert 1.0 < run.summary["sim_duration_s"] < 10.0
    assert assert_tables_are_whole(run) > 20
    assert_nothing_is_left(run, children)


@pytest.mark.parametrize("processes", ["one", slow("many")])
def test_a_run_whose_last_ua_leaves_its_wind_map_ends_at_once_and_says_so(
    start_run: StartRun, processes: str
) -> None:
    """Without any UA there are no more ticks."""
    outside = STILL + "wind: {{preset: shear, map: {{outside: error}}}}\n"  # far from the map
    run = start_run("--no-mcap", scenario=outside, processes=processes)
    assert run.finish() == 1
    assert re.search(
        r"no UA is left: UA 1: no wind: .*shear.nc: altitude \S+ is outside the map", run.output.decode()
    )
    assert [event["node"] for event in run.summary["events"] if event["kind"] == "diverged"] == ["0", "1"]
    for node, warning in zip("01", run.summary["warnings"], strict=True):
        assert warning.startswith(f"UA {node}: its flight model diverged at 0 s: no wind: ")
    assert (run.summary["ending"], run.summary["sim_duration_s"]) == ("failed", 0.0)
    assert run.summary["wall_duration_s"] < 30.0


@pytest.mark.slow
def test_one_whose_flight_model_diverges_is_told_and_the_others_fly_on(
    start_run: StartRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It has no task, so that the run can go on without it."""
    (tmp_path / "sitecustomize.py").write_text(FAULTS.format(fault="diverges"))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    run = start_run("--no-mcap", processes="one", duration_s=4.0)
    assert run.finish() == 0
    told = f"the flight model of UA 1 diverged; its last state is in {run.directory}/logs/fleet.log"
    assert told in run.output.decode()
    assert "diverged" in (run.directory / "logs" / "fleet.log").read_text()
    assert [event["node"] for event in run.summary["events"] if event["kind"] == "diverged"] == ["1"]
    [warning] = run.summary["warnings"]
    assert warning.startswith("UA 1: its flight model diverged at ")
    assert (run.summary["ending"], run.summary["sim_duration_s"]) == ("duration", 4.0)
    assert assert_tables_are_whole(run) == 81


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("processes", ["one", "many"])
def test_an_agent_that_blocks_is_given_up(start_run: StartRun, tmp_path: Path, processes: str) -> None:
    run = start_run(scenario=with_an_agent_that(tmp_path, "block"), processes=processes)
    run.wait_for("no tick for")
    children = run.children()
    assert run.finish(150.0) == 1
    assert run.summary["ending"] == "failed"
    place = r"mine\.py, line 2[78] \(on_tick\); the run waits for it"
    told = rf"; the agent of UA 1: the tick at 2.00 s takes more than 5 s of wall time, in {place}; a run "
    assert re.match(rf"sim time has stood at 2\.00 s for \d+ s{told}", run.summary["error"])
    assert "needs fdm.stall_timeout_s above 45, half of what it waits\n" in run.summary["error"]
    log = "fleet" if processes == "one" else "router"
    assert f"\nlogs/{log}.log: " in run.summary["error"]
    assert_tables_are_whole(run)
    assert_nothing_is_left(run, children)


STARTS = """\
import subprocess

from lostlink import Agent


class Mine(Agent):
    async def fly(self):
        subprocess.Popen(["sleep", "600"], start_new_session=True)
        await self.sleep(1.0)
        if self.options["does"] == "raise":
            raise ArithmeticError("a mistake of mine")
"""


@both
@pytest.mark.parametrize("does", ["end", "raise"])
def test_what_an_agent_has_started_ends_with_the_run(
    start_run: StartRun, tmp_path: Path, processes: str, does: str
) -> None:
    scenario = with_an_agent_that(tmp_path, does)
    (tmp_path / "mine.py").write_text(STARTS)
    run = start_run("--no-mcap", scenario=scenario, processes=processes, duration_s=3.0)
    assert run.finish() == (1 if does == "raise" else 0)
    told = "a process that an agent had started was ended with the run: sleep 600"
    [event] = [event for event in run.summary["events"] if event["kind"] == "process_left"]
    pid = re.fullmatch(rf"{told} \(pid (\d+)\)", event["text"])
    assert pid
    assert not psutil.pid_exists(int(pid[1])) or psutil.Process(int(pid[1])).status() == psutil.STATUS_ZOMBIE
    assert f"warning: {event['text']}\n" in run.output.decode()
    assert event["text"] in run.summary["warnings"]


IMPATIENT = "from bridge.fleet import supervisor; supervisor.SILENCE_S = 8.0"


@pytest.mark.slow
@both
def test_an_agent_that_never_awaits_sim_time_is_given_up_with_its_line(
    start_run: StartRun, tmp_path: Path, processes: str
) -> None:
    scenario = with_an_agent_that(tmp_path, "spin")
    run = start_run("--no-mcap", scenario=scenario, processes=processes, first=IMPATIENT)
    assert run.finish(60.0) == 1
    told = re.fullmatch(
        r"sim time has stood at 2\.00 s for \d+ s; the agent of UA 1: (the tick at .* s of wall time, in mine\.py, "
        r"line 1[78] \(fly\)); the run waits for it; a run whose ticks take longer needs .*",
        run.summary["error"],
        re.DOTALL,
    )
    assert told, run.summary["error"]
    assert f"warning: the agent of UA 1: {told[1]}" in run.output.decode()


ENDLESS = """\
from channel.routing.router import HopRouter
from channel.routing.settings import Relaying


class Endless(HopRouter):
    def first_notice_ns(self, node):
        return 2_000_000_000

    def notices(self, node, now_ns):
        while True:
            pass


class EndlessRouting(Relaying):
    def open(self, nodes, draws):
        return Endless(tuple(nodes), draws, self.forwarding)
"""


@pytest.mark.slow
@both
def test_a_router_of_ones_own_that_never_answers_is_told_as_the_radio_with_its_line(
    start_run: StartRun, tmp_path: Path, processes: str
) -> None:
    (tmp_path / "mine.py").write_text(ENDLESS)
    routing = f"{{{{class: {tmp_path}/mine.py:EndlessRouting}}}}"
    radio = f"radio: {{{{preset: disk, medium: {{{{model: airtime}}}}, routing: {routing}}}}}"
    scenario = STILL.replace("radio: moon2020", radio)
    run = start_run("--no-mcap", scenario=scenario, processes=processes, first=IMPATIENT)
    assert run.finish(60.0) == 1
    place = r"mine\.py, line 1[01] \(notices\)"
    text = rf"the radio: settling the tick at 2\.\d\d s takes more than 5 s of wall time, in {place}"
    error = run.summary["error"]
    assert re.match(rf"sim time has stood at [12]\.\d\d s for \d+ s; {text}; a run ", error), error
    said = run.output.decode()
    assert re.search(rf"warning: {text}\n", said)
    assert "waits for the radio\n" in said
    log = (run.directory / "logs" / ("fleet.log" if processes == "one" else "router.log")).read_text()
    assert re.search(r'mine\.py", line 1[01], in notices\n', log)
    assert re.search(r'mine\.py", line 1[01] in notices\n', log)  # when it was killed


@pytest.mark.slow
@both
def test_a_radio_that_is_at_a_tick_for_long_is_not_killed_when_the_run_is_interrupted(
    start_run: StartRun, tmp_path: Path, processes: str
) -> None:
    until = "time.monotonic() + 10.0"
    late = ENDLESS.replace(
        "while True:\n            pass",
        f"until = {until}\n        while time.monotonic() < until:\n            pass\n        return []",
    )
    (tmp_path / "mine.py").write_text(f"import time\n{late}")
    routing = f"{{{{class: {tmp_path}/mine.py:EndlessRouting}}}}"
    radio = f"radio: {{{{preset: disk, medium: {{{{model: airtime}}}}, routing: {routing}}}}}"
    grace = "from bridge.fleet import many, one; many.ROUTER_GRACE_S = one.ROUTER_GRACE_S = 2.0"
    scenario = STILL.replace("radio: moon2020", radio)
    run = start_run("--no-mcap", scenario=scenario, processes=processes, first=grace)
    run.wait_for("warning: the radio")
    run.process.send_signal(signal.SIGINT)
    assert run.finish(60.0) == 128 + signal.SIGINT
    assert run.summary["ending"] == "interrupted"
    assert run.summary["may_not_repeat"] == []
    assert "ends all processes: waits for the radio\n" in run.output.decode()


FULL = """\
from resource import RLIMIT_FSIZE, getrlimit, setrlimit
setrlimit(RLIMIT_FSIZE, (80_000, getrlimit(RLIMIT_FSIZE)[1]))
"""


@both
def test_a_full_disk_ends_the_run_and_says_so(start_run: StartRun, processes: str) -> None:
    """No file of the run may have more than so many bytes, which its tables and streams soon want."""
    run = start_run("--no-mcap", processes=processes, duration_s=LONG_S, first=FULL)
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


def counted(run: Run) -> str:
    """What a verdict says of the packets that are in the table."""
    rows = read_columns(run.directory, DELIVERIES, ("fate", "packets"))
    sent, delivered = rows["packets"].sum(), rows["packets"][rows["fate"] == "delivered"].sum()
    return f"{delivered} of {sent} packets delivered" if sent else "no link was recorded"


@pytest.mark.parametrize(
    ("processes", "victim", "name", "hosts"),
    [
        ("one", "fleet", "fleet", "auto"),
        slow("many", "router", "router", "auto"),
        ("many", "host-0", "host-0", "auto"),
        slow("many", "standin --sysid 2", "autopilot-1", "per-ua"),
        slow("many", "standin --sysid 1", "autopilots-0", "1"),
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
    assert run.summary["error"].replace(" logs/", f" {run.directory}/logs/") in text
    assert [each["text"].split(";")[0] for each in run.summary["events"] if each["kind"] == "died"] == [
        killed
    ]
    assert any(f"{killed} at" in reason for reason in run.summary["may_not_repeat"])
    assert run.summary["verdict"].startswith(f"broke off: {killed}; {counted(run)}")
    assert_tables_are_whole(run)
    assert_nothing_is_left(run, children)


@pytest.mark.parametrize(
    ("processes", "name", "ending"),
    [
        ("many", "host-0", "interrupted"),
        pytest.param("many", "router", "failed", marks=pytest.mark.long),
        slow("one", "fleet", "failed"),
    ],
)
def test_a_process_that_does_not_end_is_killed_and_the_summary_tells_it(
    start_run: StartRun, processes: str, name: str, ending: str
) -> None:
    """Whoever has the record gets more time; without it the run has failed."""
    run = start_run(processes=processes, duration_s=LONG_S)
    run.wait_for("sim time")
    children = run.children()
    run.child(name).send_signal(signal.SIGSTOP)
    run.stop(signal.SIGINT)
    assert run.summary["ending"] == ending
    events = [event["text"] for event in run.summary["events"] if event["kind"] == "killed"]
    assert any(text.startswith(f"{name} did not end in time and was killed; its log is") for text in events)
    assert any(reason.startswith(f"{name} did not end in time") for reason in run.summary["may_not_repeat"])
    assert_nothing_is_left(run, children)


@pytest.mark.parametrize(("processes", "hosts", "count"), [("one", "auto", 1), slow("many", "per-ua", 6)])
def test_a_killed_supervisor_leaves_no_process(
    start_run: StartRun, processes: str, hosts: str, count: int
) -> None:
    run = start_run("--set", f"hosts={hosts}", processes=processes, duration_s=LONG_S)
    run.wait_for("sim time")
    children = run.children()
    assert len(children) == count
    run.process.kill()
    run.finish(10.0)
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
