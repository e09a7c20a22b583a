"""The supervisor: starts the parts of a run, watches them, and ends them all."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from bridge.bus.identity.keyring import Keyring
from bridge.bus.identity.roster import roster
from bridge.bus.messages import AgentStatus, Clock, Header, Message
from bridge.bus.session import free_port
from bridge.fleet.arrangement import Arrangement
from bridge.fleet.autopilots.dirs import NOT_SAID, AutopilotDirs
from bridge.fleet.autopilots.launcher import AutopilotError, LaunchPlan
from bridge.fleet.children.child import Child
from bridge.fleet.children.crew import Crew
from bridge.fleet.children.forked import Understudy
from bridge.fleet.course import Course, Ending, FleetError
from bridge.fleet.glance import Glance
from bridge.fleet.hosts import host_groups
from bridge.fleet.how import How, calls_standins, has_bus, how_joined
from bridge.fleet.log_sizes import LogSizes
from bridge.fleet.many import ManyProcesses
from bridge.fleet.one import OneProcess, OneTask
from bridge.fleet.own_thread import in_own_thread
from bridge.fleet.preflight.ports import HOST
from bridge.fleet.preflight.preflight import launchers_of
from bridge.record.events import (
    AGENT_BLOCKED,
    DIED,
    KILLED,
    RADIO_BLOCKED,
    WHOSE,
    Report,
    RunEvent,
    read_reports,
)
from bridge.record.names import PROVENANCE_FILE
from bridge.record.provenance import Provenance, collect, files_changed_since, write_provenance
from bridge.run.directory import LOG_FOLDER, SECRETS_FOLDER, RunDirectory
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.flight import airframe_of, home_of
from bridge.scenario.resolve.named_files import named_code
from bridge.timeouts import BLOCKED_S, FAILURE_GRACE_S, LOOK_PERIOD_S, SILENCE_S

T = TypeVar("T")
ARRANGEMENTS: dict[How, type[Arrangement]] = {"many": ManyProcesses, "one": OneProcess, "task": OneTask}


class _Over(Exception):
    """The run ended while something was being waited for."""


@dataclass(frozen=True, slots=True)
class Observer:
    """What the supervisor reports of the run while it goes on.

    Attributes:
        on_phase: called with what it does now.
        on_message: called with the clock, and what agents say of themselves.
        glance: given states and link reports; None: nobody looks at them, and nobody makes them.
        joins: awaited when all parts are ready, before the first tick; None: nobody joins from outside.
        on_warning: called with what somebody must see.
    """

    on_phase: Callable[[str], object]
    on_message: Callable[[Message], object]
    glance: Glance | None = None
    joins: Callable[[], Coroutine[Any, Any, None]] | None = None
    on_warning: Callable[[str], object] = lambda _: None


class Fleet:
    """All parts of one run.

    Args:
        scenario: what to fly.
        run: its directory, already there.
        observer: called with phases and messages.
        dirs: where real autopilots are, as far as that was said.
        replay: directory of the run whose inputs from outside are repeated.
        how: how the parts are joined; None: as the scenario says.
        understudies: of processes of the run, by their names (`bridge.fleet.understudies`).

    Attributes:
        course: how the run goes.
        killed: processes that did not end when they were asked to.
    """

    def __init__(
        self,
        scenario: Scenario,
        run: RunDirectory,
        observer: Observer,
        dirs: AutopilotDirs = NOT_SAID,
        replay: Path | None = None,
        how: How | None = None,
        understudies: Mapping[str, Understudy] = MappingProxyType({}),
    ) -> None:
        self._scenario, self._run, self._observer, self._replay = scenario, run, observer, replay
        self._how: How = how or how_joined(scenario)
        self._launchers = launchers_of(scenario, dirs)
        self._crew = Crew(self._child_ended, understudies)
        self._parts: Arrangement | None = None
        self._keyring: Keyring | None = None
        self._made = Provenance()
        self._outcome: asyncio.Future[Ending] = asyncio.get_running_loop().create_future()
        self.course = Course(scenario, run)
        self.killed: list[str] = []
        self._report = Report(run.path, "supervisor")
        self._last_tick = asyncio.get_running_loop().time()
        self._pace = (False, scenario.speed_factor)
        """Whether an operator holds the clock, and the speed that is aimed at."""
        self._told_of_radio: RunEvent | None = None
        self._news = asyncio.Event()
        self.glance = observer.glance

    @property
    def recorder(self) -> str:
        """The process without whose end the record is not complete."""
        return "" if self._parts is None else self._parts.recorder

    @property
    def is_over(self) -> bool:
        """Whether it is known how the run ends."""
        return self._outcome.done()

    def interrupt(self) -> None:
        """End the run now."""
        self._settle(Ending.INTERRUPTED)

    async def fly(self) -> Ending:
        """Start everything, wait for the end of the flight, end everything.

        Raises:
            FleetError: if a process does not start, dies or reports failure.
        """
        try:
            return await self._fly()
        finally:
            await asyncio.shield(self._end())

    def _write_provenance(self) -> None:
        origins = {ua.node: self._launchers.of(ua).origin(ua) for ua in self._scenario.ua}
        code = named_code(self._scenario)
        self._made = collect(origins, code.files, code.packages)
        write_provenance(self._made, self._run.path)

    def _tell_changed_files(self) -> None:
        """Files are loaded after they were looked at, some only when code asks for them."""
        for path in files_changed_since(self._made):
            self._report.may_not_repeat(
                f"{path} was changed while the run flew: {PROVENANCE_FILE} has it as it was before"
            )

    async def _fly(self) -> Ending:
        try:
            await in_own_thread(self._write_provenance)
        except AutopilotError as error:
            raise FleetError(str(error)) from error
        self._write_run()
        parts = self._parts = ARRANGEMENTS[self._how](self._run, self._crew, self, self._observer.on_phase)
        starts_autopilots = not calls_standins(self._scenario)
        try:
            await parts.start()
            if starts_autopilots:
                self._start_autopilots(waits_for_physics=True)
            await self._unless_over(self._ready(parts))
            if self._observer.joins is not None:
                await self._unless_over(self._observer.joins())
            parts.go()
            if starts_autopilots:
                self._start_autopilots(waits_for_physics=False)
            self._observer.on_phase("waits for the autopilots")
            return await self._unless_over(self._watch_clock())
        except _Over:
            return self._outcome.result()

    async def _ready(self, parts: Arrangement) -> None:
        try:
            await parts.ready()
        except FleetError as error:
            raise FleetError(f"{error}{self._at_work()}") from error

    def _write_run(self) -> None:
        """Write what the parts read: where the router is, if there is one, and who may log in."""
        scenario = self._scenario
        if not has_bus(scenario):
            self._run.write(scenario, "", self._replay)
            return
        endpoint = f"tcp/{HOST}:{scenario.ports.zenoh or free_port()}"
        hosts = host_groups(scenario) if self._how == "many" else {}
        free = {node.node for node in scenario.transceivers if not node.has_agent}
        identities = roster(scenario.transceiver_ids, hosts, free)
        self._keyring = Keyring.create(self._run.path / SECRETS_FOLDER, identities)
        self._run.write(scenario, endpoint, self._replay, hosts, self._keyring)

    def _start_autopilots(self, *, waits_for_physics: bool) -> None:
        scenario = self._scenario
        for launcher, fleet in self._launchers.each(waits_for_physics=waits_for_physics):
            self._observer.on_phase(f"starts autopilots ({scenario.autopilot_of(fleet[0])})")
            plans = [
                LaunchPlan(self._run, scenario, ua, airframe_of(ua), home_of(ua, scenario.origin))
                for ua in fleet
            ]
            try:
                for autopilot in launcher.processes(plans):
                    self._crew.start(autopilot)
            except AutopilotError as error:
                raise FleetError(str(error)) from error

    def _child_ended(self, child: Child) -> None:
        what = f"{child.spec.name} {child.how_it_ended}"
        why = child.why_it_ended
        text = f"{what}{why and f': {why}'}; its log is {child.spec.log_path}"
        if not self._outcome.done():
            self._report.event(self.course.sim_time_ns, "", DIED, text)
            self._report.may_not_repeat(
                f"{what} at {self.course.sim_time_ns / 1e9:.2f} s, before the run ended"
            )
        words = "" if why else child.last_words()
        self._settle(FleetError(f"{text}\n{words}" if words else text))

    def _settle(self, outcome: Ending | FleetError) -> None:
        if self._outcome.done():
            return
        if isinstance(outcome, Ending):
            self._outcome.set_result(outcome)
        else:
            self._outcome.set_exception(outcome)

    async def _unless_over(self, work: Coroutine[Any, Any, T]) -> T:
        """Wait for ``work``, but not longer than the run lasts."""
        task = asyncio.create_task(work)
        try:
            waiting: set[asyncio.Future[Any]] = {task, self._outcome}
            await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
            if self._outcome.done():
                raise _Over
            return task.result()
        finally:
            task.cancel()

    async def _watch_clock(self) -> Ending:
        """Wait for the end of the run; give it up when time stands still.

        Only time in which we look counts: while we are stopped (Ctrl-Z), ticks wait to be read.
        """
        patience_s, sizes = patience_of(self._scenario), LogSizes(self._run.path / LOG_FOLDER)
        silence_s = 0.0
        while True:
            before = self._last_tick
            await asyncio.sleep(LOOK_PERIOD_S)
            for text in sizes.told():
                self._observer.on_warning(text)
            silence_s = silence_s + LOOK_PERIOD_S if self._last_tick == before else 0.0
            if silence_s > BLOCKED_S:
                self._tell_of_the_radio()
            if silence_s > patience_s:
                at_s = self.course.sim_time_ns / 1e9
                raise FleetError(
                    f"sim time has stood at {at_s:.2f} s for {silence_s:.0f} s{self._at_work()}; a run whose "
                    f"ticks take longer needs fdm.stall_timeout_s above {patience_s / 2:g}, half of what it waits"
                    f"{self._crew.tails()}"
                )

    def _at_work(self) -> str:
        """Agents, and the radio, that have been at the tick at which sim time stands, or in constructors, for long."""
        told = [
            f"; {WHOSE[event.kind]}{self._scenario.title(event.node)}: {event.text}"
            for event in self._blocked(AGENT_BLOCKED)
        ]
        told += [f"; the radio: {event.text}" for event in self._blocked(RADIO_BLOCKED)]
        return "".join(told)

    def _blocked(self, kind: str) -> list[RunEvent]:
        """What was reported of the tick at which sim time stands."""
        scenario = self._scenario
        since_ns = self.course.sim_time_ns - scenario.lookahead_ticks * scenario.tick_period_ns
        events = read_reports(self._run.path).events
        return [event for event in events if event.kind == kind and event.sim_time_ns >= since_ns]

    def _tell_of_the_radio(self) -> None:
        """Say, once until the next tick, that it is the radio for which all wait."""
        if self._told_of_radio is None and (events := self._blocked(RADIO_BLOCKED)):
            self._told_of_radio = events[-1]
            self._observer.on_warning(f"the radio: {events[-1].text}")
            self._observer.on_phase("waits for the radio")

    async def _end(self) -> None:
        """End everything, and say what came for the supervisor and was not handled; and whom it had to kill."""
        self._settle(Ending.INTERRUPTED)
        self._observer.on_phase("ends all processes")
        if self._parts is not None:
            patience = asyncio.create_task(self._let_the_radio_finish())
            self.killed = await self._parts.end(self._news)
            patience.cancel()
            self._report.count("samples_whose_handling_failed", self._parts.failed)
        self._crew.dismiss()
        if self._keyring is not None:
            self._keyring.remove()
        for name in self.killed:
            what = f"{name} did not end in time and was killed"
            log = self._run.log_path(name)
            self._report.event(self.course.sim_time_ns, "", KILLED, f"{what}; its log is {log}")
            self._report.may_not_repeat(
                f"{what} after {self.course.sim_time_ns / 1e9:.2f} s: its files may lack their end"
            )
        await in_own_thread(self._tell_changed_files)
        self._report.close()

    async def _let_the_radio_finish(self) -> None:
        """A radio that is at a tick may take as long for it as it may in flight: that it is at work counts as news."""
        told, loop = False, asyncio.get_running_loop()
        while loop.time() - self._last_tick < _owed_s(self._scenario):
            if self._blocked(RADIO_BLOCKED):
                self._news.set()
                if not told:
                    self._observer.on_phase("ends all processes: waits for the radio")
                told = True
            await asyncio.sleep(LOOK_PERIOD_S)

    # What the parts report (`bridge.fleet.tidings.Tidings`).

    def clock(self, clock: Clock) -> None:
        """A tick."""
        self._last_tick = asyncio.get_running_loop().time()
        if self._told_of_radio is not None:
            self._told_of_radio = None
            self._observer.on_phase("flies")
        for node, error in self.course.tick(clock):
            if node in self.course.unfinished:
                self._settle(error)
            else:
                self._observer.on_phase(str(error))
        self._observer.on_message(clock)

    def pace(self, clock: Clock) -> None:
        """An operator holds the clock, or lets it go: while it is held nobody waits for ticks."""
        self._last_tick = asyncio.get_running_loop().time()
        pace = (clock.paused, clock.speed)
        if pace != self._pace:
            self._pace = pace
            self._observer.on_phase("is held by an operator" if clock.paused else "flies")

    def agent(self, node: str, status: AgentStatus) -> None:
        """What an agent says of itself. A failed one ends the run with its tick, or soon if that cannot be closed."""
        if node not in self._scenario.transceiver_ids:
            return
        had_failed = self.course.failure is not None
        status = self.course.agent(node, status)
        if self.course.failure is not None and not had_failed:
            asyncio.get_running_loop().call_later(FAILURE_GRACE_S, self._give_up)
        self._observer.on_message(status)

    def _give_up(self) -> None:
        """The tick at which an agent failed was not closed."""
        if self.course.failure is not None:
            self._settle(self.course.failure)

    def end(self, header: Header) -> None:
        """The last tick is closed."""
        self._settle(self.course.end())
        self._observer.on_message(header)

    def ending(self, header: Header) -> None:
        """How far the record is: whoever waits for it waits on."""
        self._news.set()
        self._observer.on_phase(f"the radio {header.frame_id}")

    def warning(self, header: Header) -> None:
        """What somebody must see while the run goes on."""
        self._observer.on_warning(header.frame_id)

    def lost(self, text: str) -> None:
        """A part cannot go on."""
        self._settle(FleetError(text))


def patience_of(scenario: Scenario) -> float:
    """How long, in wall time, sim time may stand still: longer than an autopilot may owe its packet."""
    if "external" in scenario.autopilots:
        return float("inf")
    return _owed_s(scenario)


def _owed_s(scenario: Scenario) -> float:
    return max(SILENCE_S, 2 * scenario.fdm.stall_timeout_s)
