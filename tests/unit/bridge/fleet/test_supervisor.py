"""The supervisor gives a run up when it has to, and tells what became of its processes."""

from __future__ import annotations

import asyncio
import math
import re
import sys
import time
from pathlib import Path

import pytest

from bridge.bus.messages import Clock, Header
from bridge.fleet import many, supervisor
from bridge.fleet.children.child import ProcessSpec
from bridge.fleet.course import Ending, FleetError
from bridge.fleet.many import ManyProcesses
from bridge.fleet.supervisor import Fleet, Observer, patience_of
from bridge.record.events import AGENT_BLOCKED, Report, Reports, RunEvent, read_reports
from bridge.run.directory import RunDirectory
from bridge.scenario.file import read_scenario, with_changes
from bridge.timeouts import SILENCE_S


@pytest.mark.parametrize(
    ("changes", "patience_s"),
    [
        ({}, SILENCE_S),
        ({"fdm.stall_timeout_s": 45.0}, SILENCE_S),
        ({"fdm.stall_timeout_s": 300.0}, 600.0),
        ({"fdm.stall_timeout_s": 300.0, "autopilot": "external"}, math.inf),
    ],
)
def test_time_may_stand_still_for_longer_than_an_autopilot_may_be_silent(
    changes: dict[str, object], patience_s: float
) -> None:
    assert patience_of(with_changes(read_scenario("separation"), changes)) == patience_s


TICK_NS = 50_000_000
STUBBORN = "import signal, time; signal.signal(15, lambda *_: None); print('up', flush=True); time.sleep(60)"
OBSERVER = Observer(lambda _: None, lambda _: None)


class OneProcess(Fleet):
    """A fleet of one process that runs ``script``; 12.5 s of sim time pass, then the run ends unless it broke off."""

    script = STUBBORN
    name = "host-0"

    async def _fly(self) -> Ending:
        log = self._run.log_path(self.name)
        self._write_run()
        self._parts = ManyProcesses(self._run, self._crew, self, self._observer.on_phase)
        child = self._crew.start(ProcessSpec(self.name, [sys.executable, "-c", self.script], log))
        while "up" not in log.read_text() and not child.ended.done():  # noqa: ASYNC110 - a file has no event
            await asyncio.sleep(0.01)
        self.clock(Clock(Header.at(12_500_000_000, "")))
        if self.script is STUBBORN:
            return Ending.DONE
        await asyncio.wait_for(self._outcome, 20.0)
        raise AssertionError("the process did not end")


@pytest.fixture
def run(tmp_path: Path) -> RunDirectory:
    return RunDirectory.create(tmp_path, "one")


def told(run: RunDirectory) -> tuple[Reports, RunEvent]:
    reports = read_reports(run.path)
    [event] = reports.events
    return reports, event


async def test_a_process_that_had_to_be_killed_is_an_event_and_a_reason(
    run: RunDirectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(many, "AGENT_GRACE_S", 0.2)
    fleet = OneProcess(read_scenario("separation"), run, OBSERVER, how="many")
    assert await fleet.fly() is Ending.DONE
    assert fleet.killed == ["host-0"]
    reports, event = told(run)
    assert (event.sim_time_ns, event.node, event.kind) == (12_500_000_000, "", "killed")
    assert event.text == "host-0 did not end in time and was killed; its log is logs/host-0.log"
    assert reports.may_not_repeat == (
        "host-0 did not end in time and was killed after 12.50 s: its files may lack their end",
    )


async def test_a_process_that_died_is_an_event_and_a_reason(
    run: RunDirectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        OneProcess, "script", "import time; print('up', flush=True); time.sleep(0.5); raise SystemExit(3)"
    )
    with pytest.raises(FleetError, match="host-0 ended with status 3"):
        await OneProcess(read_scenario("separation"), run, OBSERVER, how="many").fly()
    reports, event = told(run)
    assert (event.sim_time_ns, event.node, event.kind) == (12_500_000_000, "", "died")
    assert event.text == "host-0 ended with status 3; its log is logs/host-0.log"
    assert reports.may_not_repeat == ("host-0 ended with status 3 at 12.50 s, before the run ended",)


async def test_of_a_process_that_is_killed_the_log_is_asked_for_what_went_wrong_alone(
    run: RunDirectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    line = "2026-11-26 11:26:47,344 12.050s INFO host: MAVLink of UA 0 is up"
    monkeypatch.setattr(
        OneProcess, "script", f"import os; print({line!r}, flush=True); os.kill(os.getpid(), 9)"
    )
    with pytest.raises(FleetError, match=r"^host-0 was ended by SIGKILL; its log is .*host-0\.log$"):
        await OneProcess(read_scenario("separation"), run, OBSERVER, how="many").fly()


class WithoutLog(Fleet):
    """A fleet of one process that dies when its log has been removed."""

    async def _fly(self) -> Ending:
        self._write_run()
        self._parts = ManyProcesses(self._run, self._crew, self, self._observer.on_phase)
        command = [sys.executable, "-c", "import time; time.sleep(60)"]
        log = self._run.log_path("host-0")
        child = self._crew.start(ProcessSpec("host-0", command, log))
        log.unlink()
        child.kill()
        return await asyncio.wait_for(self._outcome, 10.0)


async def test_a_process_that_dies_ends_the_run_also_when_its_log_has_been_removed(run: RunDirectory) -> None:
    with pytest.raises(FleetError, match=r"^host-0 was ended by SIGKILL; its log is .*host-0\.log$"):
        await WithoutLog(read_scenario("separation"), run, OBSERVER, how="many").fly()


class OnlyWatched(Fleet):
    """A fleet without processes, whose clock is watched."""

    async def _fly(self) -> Ending:
        self._write_run()
        return await self._watch_clock()


async def test_a_run_is_not_given_up_for_the_time_in_which_its_command_was_stopped(
    run: RunDirectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The kernel tells a process that was stopped of its timers first, then of what waits in its sockets."""
    monkeypatch.setattr(supervisor, "patience_of", lambda _: 0.5)
    monkeypatch.setattr(supervisor, "LOOK_PERIOD_S", 0.05)
    fleet = OnlyWatched(read_scenario("separation"), run, OBSERVER, how="many")
    flight = asyncio.create_task(fleet.fly())
    await asyncio.sleep(0.1)
    time.sleep(1.0)  # noqa: ASYNC251 - as if stopped
    await asyncio.sleep(0.06)  # until it has looked
    assert not flight.done()
    fleet.clock(Clock(Header.at(1_000_000_000, "")))
    before = time.monotonic()
    with pytest.raises(
        FleetError, match=r"sim time has stood at 1\.00 s for \d+ s; a run whose ticks take longer"
    ):
        await flight
    assert time.monotonic() - before > 0.5


@pytest.mark.parametrize(("lookahead_ticks", "at_ns"), [(0, 1_000_000_000), (1, 1_000_000_000 - TICK_NS)])
async def test_a_run_given_up_for_an_agent_says_which_and_its_line(
    run: RunDirectory, monkeypatch: pytest.MonkeyPatch, lookahead_ticks: int, at_ns: int
) -> None:
    monkeypatch.setattr(supervisor, "patience_of", lambda _: 0.2)
    monkeypatch.setattr(supervisor, "LOOK_PERIOD_S", 0.05)
    scenario = with_changes(read_scenario("separation"), {"lookahead_ticks": lookahead_ticks})
    report = Report(run.path, "node-1")
    for sim_time_ns, line in ((at_ns - TICK_NS, 3), (at_ns, 7)):
        text = f"the tick takes long, in mine.py, line {line} (fly)"
        report.event(sim_time_ns, "1", AGENT_BLOCKED, text)
    report.close()
    fleet = OnlyWatched(scenario, run, OBSERVER, how="many")
    fleet.clock(Clock(Header.at(1_000_000_000, "")))
    with pytest.raises(FleetError) as told:
        await fleet.fly()
    first, _, _ = str(told.value).partition(
        "; a run whose ticks take longer needs fdm.stall_timeout_s above "
    )
    assert re.fullmatch(
        r"sim time has stood at 1\.00 s for \d+ s; the agent of UA 1: the tick takes long, in mine\.py, line 7 \(fly\)",
        first,
    )
