"""kill -9 of any process of a run: what it recorded can be read and has no holes, and nothing is left running.

One that is only frozen flies on when it thaws.
"""

from __future__ import annotations

import os
import queue
import signal
import time
from typing import Any

import numpy as np
import psutil
import pytest
from numpy.typing import NDArray

from bridge.bus.keys import Keys
from bridge.bus.messages import Clock, decode
from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.reader import read_columns
from bridge.record.tables.schema import Table
from bridge.record.tables.truth import TRUTH
from tests.integration.bridge.conftest import STILL, Run, StartRun

SPEED = 4.0
FREEZE_S = 12.0
"""Wall time: Zenoh cuts off whom it has not heard for 10 s, unless it is told otherwise."""
LOST_MAX_S = 2.0
"""Wall time: tables are flushed each second; a busy machine takes its time."""
KILLS = int(os.environ.get("LOSTLINK_KILLS", "1"))
"""Of each process; the figure in docs/explanation/performance.md is from 10."""
PROCESSES = {
    "router": ("many", "router"),
    "host": ("many", "host-0"),
    "supervisor": ("many", ""),
    "fleet": ("one", "fleet"),
    "supervisor of one": ("one", ""),
}
LIKE_OTHERS = {"router", "supervisor"}
"""Long tests: the fleet's one process has the router's writers, and a supervisor of one is a supervisor."""


def column(run: Run, table: Table, name: str) -> NDArray[Any]:
    """All of one column; empty if the kill came within the first second."""
    return read_columns(run.directory, table, (name,))[name]


@pytest.mark.slow
@pytest.mark.parametrize("number", range(KILLS))
@pytest.mark.parametrize(
    "process",
    [pytest.param(name, marks=pytest.mark.long if name in LIKE_OTHERS else ()) for name in PROCESSES],
)
def test_kill_at_a_random_moment(start_run: StartRun, process: str, number: int) -> None:
    moment_s = float(np.random.default_rng([len(process), number]).uniform(0.5, 4.0))  # wall time
    processes, command = PROCESSES[process]
    run = start_run(scenario=STILL.replace("moon2020", "corrected"), speed=str(SPEED), processes=processes)
    run.wait_for("sim time")
    clock_ns = 0

    def tick(sample: object) -> None:
        nonlocal clock_ns
        clock_ns = decode(sample.payload.to_bytes(), Clock).header.stamp.ns  # type: ignore[attr-defined]

    with run.join("observer") as session:
        session.subscribe(Keys(run.directory.name).clock, tick)
        time.sleep(moment_s)  # the random moment, not a wait for something
        children = run.children()
        victim = run.child(command) if command else psutil.Process(run.process.pid)
        at_ns = clock_ns
        victim.send_signal(signal.SIGKILL)
    run.finish(30.0)
    _, alive = psutil.wait_procs(children, timeout=15.0)
    assert not alive
    assert at_ns > 0
    newest_ns = at_ns - SPEED * LOST_MAX_S * 1e9
    times, tx, seq = (column(run, DELIVERIES, name) for name in ("sim_time_ns", "tx", "seq"))
    assert times.max(initial=0) >= newest_ns
    for node in ("0", "1"):
        assert (seq[tx == node] == np.arange((tx == node).sum())).all()  # no packet is missing
    ticks = column(run, TRUTH, "tick_ns")
    assert (np.unique(ticks) == np.arange(len(np.unique(ticks))) * 50_000_000).all()
    assert ticks.max(initial=0) >= newest_ns


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("frozen", ["router", "host-"])
def test_a_run_flies_on_after_its_processes_were_frozen(start_run: StartRun, frozen: str) -> None:
    run = start_run(speed=str(SPEED), processes="many")
    run.wait_for("sim time")
    victims = [child for child in run.children() if child.name().startswith(frozen)]
    for victim in victims:
        victim.suspend()
    time.sleep(FREEZE_S)  # the length of the freeze, not a wait for something
    ticks: queue.SimpleQueue[object] = queue.SimpleQueue()
    for victim in victims:
        victim.resume()
    with run.join("observer") as session:
        session.subscribe(Keys(run.directory.name).clock, ticks.put)
        for _ in range(100):
            ticks.get(timeout=20.0)
    run.stop(signal.SIGINT)
    assert run.summary["ending"] == "interrupted"
