"""The supervisor: starts the processes of a run in order, watches them, and ends them all."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Callable, Coroutine, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, TypeVar

from bridge.bus.identity.keyring import Credentials, Keyring
from bridge.bus.identity.roster import SUPERVISOR, roster
from bridge.bus.inbox import Inbox
from bridge.bus.keys import Keys
from bridge.bus.messages import AgentStatus, Clock, DecodeError, Header, Message, decode
from bridge.bus.session import Sample, Session, SessionError, free_port, open_client
from bridge.fleet.autopilots.launcher import AutopilotError, Launcher, LaunchPlan
from bridge.fleet.autopilots.launchers import LAUNCHERS
from bridge.fleet.child import Child, ProcessSpec, end_all, end_with_news
from bridge.fleet.environment import environment_of
from bridge.fleet.glance import Glance
from bridge.fleet.hosts import PREFIX, host_groups
from bridge.fleet.ports import HOST, conflicts, ports_of
from bridge.record.events import DIED, KILLED, Report
from bridge.record.provenance import collect, write_provenance
from bridge.run.directory import SECRETS_FOLDER, RunDirectory
from bridge.scenario.agents import FreeAgent, OwnAgent
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.flight import airframe_of, home_of, wind_of
from bridge.scenario.resolve.named_files import named_files
from bridge.timeouts import (
    AGENT_GRACE_S,
    FAILURE_GRACE_S,
    FLIGHT_GRACE_S,
    NEWS_PERIOD_S,
    ROUTER_GRACE_S,
    SILENCE_S,
    START_S,
)
from fdm.errors import WindError

MODULES = {
    "router": "bridge.radio.process",
    "physics": "bridge.physics.process",
    "host": "bridge.host.process",
}
"""What runs as which process."""

T = TypeVar("T")


class FleetError(RuntimeError):
    """The run could not start or broke off; the text says which process and where its log is."""


class _Over(Exception):
    """The run ended while something was being waited for."""


class Ending(StrEnum):
    """Why a run ended."""

    DONE = "done"
    DURATION = "duration"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class Observer:
    """What the supervisor tells of the run while it goes on.

    Attributes:
        on_phase: told what it does now.
        on_message: told the clock, and what agents say of themselves.
        glance: given states and link reports; None: nobody looks at them, and nobody makes them.
    """

    on_phase: Callable[[str], object]
    on_message: Callable[[Message], object]
    glance: Glance | None = None


class Fleet:
    """All processes of one run.

    Args:
        scenario: what to fly.
        run: its directory, already there.
        observer: told of phases and messages.
        ardupilot_dir: where real binaries are, if that was said.
        replay: directory of the run whose inputs from outside are repeated.
    """

    def __init__(
        self,
        scenario: Scenario,
        run: RunDirectory,
        observer: Observer,
        ardupilot_dir: Path | None = None,
        replay: Path | None = None,
    ) -> None:
        self._scenario = scenario
        self._run = run
        self._observer = observer
        self._replay = replay
        self._failure: FleetError | None = None
        self._environment = environment_of(os.environ)
        self._launcher = launcher_of(scenario, ardupilot_dir)
        self._hosts = host_groups(scenario)
        self._children: list[Child] = []
        self._router: Child | None = None
        self._session: Session | None = None
        self._keyring: Keyring | None = None
        loop = asyncio.get_running_loop()
        self._outcome: asyncio.Future[Ending] = loop.create_future()
        # What decides the run is never dropped.
        self._control: Inbox[tuple[type[Message], Sample]] = Inbox(loop, self._on_sample, limit=None)
        self.not_done = {
            node.node
            for node in scenario.transceivers
            if node.agent.has_task or not isinstance(node.agent, OwnAgent | FreeAgent)
        }
        """Nodes whose agents have not flown what they were to fly: also one that was only to hold."""
        self.killed: list[str] = []
        """Processes that did not end when they were asked to."""
        self._report = Report(run.path, "supervisor")
        self._ended: set[str] = set()
        self._last_tick = loop.time()
        self._pace = (False, scenario.speed_factor)
        """Whether an operator holds the clock, and the speed that is aimed at."""
        self._news = asyncio.Event()
        self.sim_time_ns = 0

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
        origins = {ua.node: self._launcher.origin(ua) for ua in self._scenario.ua}
        write_provenance(collect(origins, named_files(self._scenario)), self._run.path)

    async def _fly(self) -> Ending:
        try:
            await asyncio.to_thread(self._write_provenance)
        except AutopilotError as error:
            raise FleetError(str(error)) from error
        endpoint = f"tcp/{HOST}:{self._scenario.ports.zenoh or free_port()}"
        free = {node.node for node in self._scenario.transceivers if not node.has_agent}
        identities = roster(self._scenario.transceiver_ids, self._hosts, free)
        self._keyring = Keyring.create(self._run.path / SECRETS_FOLDER, identities)
        info = self._run.write(self._scenario, endpoint, self._replay, self._hosts, self._keyring)
        try:
            everybody = await self._start_ours()
            keys = Keys(info.run)
            self._session = await self._unless_over(_connect(endpoint, self._keyring.credentials(SUPERVISOR)))
            self._listen(self._session, keys)
            await self._unless_over(self._all_alive(self._session, keys, everybody))
            self._session.put(keys.clock_start, Header(), must_arrive=True)
            if not self._launcher.waits_for_physics:
                await self._start_autopilots()
            self._observer.on_phase("waits for the autopilots")
            return await self._unless_over(self._watch_clock())
        except _Over:
            return self._outcome.result()

    async def _start_ours(self) -> set[str]:
        """Start our own processes, all at once; return the names of those that say when they are ready."""
        self._observer.on_phase("starts the radio router")
        self._router = await self._start(self._python("router"))
        self._observer.on_phase("starts flight dynamics, MAVLink daemons and agents")
        specs = [self._python("physics")]
        specs += [self._python("host", name, nodes) for name, nodes in self._hosts.items()]
        for spec in specs:
            await self._start(spec)
        if self._launcher.waits_for_physics:
            await self._start_autopilots()
        return {"router", *(spec.name for spec in specs)}

    async def _start_autopilots(self) -> None:
        scenario = self._scenario
        self._observer.on_phase(f"starts autopilots ({scenario.autopilot})")
        plans = [
            LaunchPlan(self._run, scenario, ua, airframe_of(ua), home_of(ua, scenario.origin))
            for ua in scenario.ua
        ]
        try:
            for autopilot in self._launcher.processes(plans):
                await self._start(replace(autopilot, environment=self._environment))
        except AutopilotError as error:
            raise FleetError(str(error)) from error

    def _python(self, module: str, name: str = "", nodes: Sequence[str] = ()) -> ProcessSpec:
        name = name or module
        command = [sys.executable, "-m", MODULES[module], "--run-dir", str(self._run.path), "--name", name]
        command += ["--nodes", ",".join(nodes)] if nodes else []
        return ProcessSpec(name, command, self._run.log_path(name), environment=self._environment)

    async def _start(self, spec: ProcessSpec) -> Child:
        try:
            child = await Child.start(spec)
        except OSError as error:
            raise FleetError(f"{spec.name} could not be started: {error}") from error
        self._children.append(child)
        child.ended.add_done_callback(lambda _: self._child_ended(child))
        return child

    def _child_ended(self, child: Child) -> None:
        what = f"{child.spec.name} {child.how_it_ended}"
        text = f"{what}; its log is {child.spec.log_path}"
        if not self._outcome.done():
            self._report.event(self.sim_time_ns, "", DIED, text)
            self._report.may_not_repeat(f"{what} at {self.sim_time_ns / 1e9:.2f} s, before the run ended")
        tail = child.log_tail()
        self._settle(FleetError(f"{text}\n{tail}" if tail else text))

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

    async def _end(self) -> None:
        """End everything: hosts first, so that nobody transmits into a dying router; the router last."""
        self._settle(Ending.INTERRUPTED)
        self._observer.on_phase("ends all processes")
        hosts = [child for child in self._children if child.spec.name.startswith(PREFIX)]
        others = [c for c in self._children if c not in hosts and c is not self._router]
        self.killed += await end_all(hosts, AGENT_GRACE_S)
        self.killed += await end_all(others, FLIGHT_GRACE_S)
        if self._router is not None:
            self.killed += await end_with_news(self._router, self._news, ROUTER_GRACE_S)
        if self._session is not None:
            self._session.close()
        if self._keyring is not None:
            self._keyring.remove()
        self._tell_what_was_missed()

    def _tell_what_was_missed(self) -> None:
        """What came for the supervisor and was not handled, or not shown; and whom it had to kill."""
        self._report.count("samples_whose_handling_failed", self._control.failed)
        for name in self.killed:
            what = f"{name} did not end in time and was killed"
            log = self._run.log_path(name)
            self._report.event(self.sim_time_ns, "", KILLED, f"{what}; its log is {log}")
            self._report.may_not_repeat(
                f"{what} after {self.sim_time_ns / 1e9:.2f} s: its files may lack their end"
            )
        self._report.close()

    # --- what the processes tell

    def _listen(self, session: Session, keys: Keys) -> None:
        def subscribe(key_expr: str, cls: type[Message]) -> None:
            session.subscribe(key_expr, lambda sample: self._control.push((cls, sample)))

        subscribe(keys.clock, Clock)
        subscribe(keys.clock_end, Header)
        pace: Inbox[Sample] = Inbox(asyncio.get_running_loop(), self._on_pace)
        session.subscribe(keys.clock_pace, pace.push)
        subscribe(keys.agent("*"), AgentStatus)
        glance = self._observer.glance
        if glance is not None:
            session.subscribe(keys.state("*"), glance.state_came)
            session.subscribe(keys.tick("links"), glance.links_came)
        ending: Inbox[Sample] = Inbox(asyncio.get_running_loop(), self._on_ending)
        session.subscribe(keys.ending, ending.push)

    def _on_pace(self, sample: Sample) -> None:
        """An operator holds the clock, or lets it go: while it is held nobody waits for ticks."""
        try:
            clock = decode(sample.payload.to_bytes(), Clock)
        except DecodeError as error:
            self._observer.on_phase(f"ignores a malformed message on {sample.key_expr}: {error}")
            return
        self._last_tick = asyncio.get_running_loop().time()
        pace = (clock.paused, clock.speed)
        if pace == self._pace:
            return
        self._pace = pace
        self._observer.on_phase("is held by an operator" if clock.paused else "flies")

    def _on_ending(self, sample: Sample) -> None:
        """The router tells how far its record is: whoever waits for it waits on."""
        self._news.set()
        try:
            self._observer.on_phase(f"the radio {decode(sample.payload.to_bytes(), Header).frame_id}")
        except DecodeError as error:
            self._observer.on_phase(f"ignores a malformed message on {sample.key_expr}: {error}")

    def _on_sample(self, item: tuple[type[Message], Sample]) -> None:
        cls, sample = item
        try:
            message = decode(sample.payload.to_bytes(), cls)
        except DecodeError as error:
            self._observer.on_phase(f"ignores a malformed message on {sample.key_expr}: {error}")
            return
        if isinstance(message, Clock):
            self._on_clock(message)
        elif isinstance(message, AgentStatus):
            node = self._run.keys.node_of(str(sample.key_expr))  # the key says who it is
            if node not in self._scenario.transceiver_ids:
                return
            message = replace(message, header=Header(message.header.stamp, node))
            self._on_agent(message)
        elif isinstance(message, Header):
            all_done = self._scenario.nodes_with_a_task and not self._unfinished
            self._settle(self._failure or (Ending.DONE if all_done else Ending.DURATION))
        self._observer.on_message(message)

    @property
    def _unfinished(self) -> frozenset[str]:
        """Nodes whose agents have a task and have not done it: what the run waits for."""
        return self._scenario.nodes_with_a_task & self.not_done

    def _on_clock(self, clock: Clock) -> None:
        self._last_tick = asyncio.get_running_loop().time()
        self.sim_time_ns = clock.header.stamp.ns
        for node in sorted(set(clock.ended) - self._ended):
            self._on_model_ended(node)

    def _on_model_ended(self, node: str) -> None:
        self._ended.add(node)
        text = f"the flight model of UA {node} diverged; its last state is in {self._run.log_path('physics')}"
        if node in self._unfinished:
            self._settle(FleetError(text))
        else:
            self._observer.on_phase(text)

    def _on_agent(self, status: AgentStatus) -> None:
        node = status.header.frame_id
        if status.failed:
            log = self._run.log_path(f"node-{node}")
            where = f"; its log is {log}" if log.exists() else ""  # a program beside the run has its own
            text = f"the agent of {self._scenario.title(node)} failed: {status.activity}{where}"
            self._fail_with_the_tick(FleetError(text))
        if status.done:
            self.not_done.discard(node)

    def _fail_with_the_tick(self, error: FleetError) -> None:
        """Break off when the tick is closed (the radio ends the run with it), or soon if it cannot be."""
        if self._failure is None:
            self._failure = error
            asyncio.get_running_loop().call_later(FAILURE_GRACE_S, self._settle, error)

    async def _all_alive(self, session: Session, keys: Keys, names: set[str]) -> None:
        everybody = asyncio.Event()
        missing = set(names)

        def on_token(token: tuple[str, bool]) -> None:
            key, is_alive = token
            if is_alive:
                missing.discard(keys.last_chunk(key))
            if not missing:
                everybody.set()

        inbox: Inbox[tuple[str, bool]] = Inbox(asyncio.get_running_loop(), on_token)
        session.watch_alive(keys.alive("*"), lambda key, is_alive: inbox.push((key, is_alive)))
        deadline = asyncio.get_running_loop().time() + START_S
        while missing:
            with suppress(TimeoutError):
                await asyncio.wait_for(everybody.wait(), NEWS_PERIOD_S)
            if missing and asyncio.get_running_loop().time() > deadline:
                logs = ", ".join(str(self._run.log_path(name)) for name in sorted(missing))
                late = ", ".join(sorted(missing))
                raise FleetError(f"not ready within {START_S:g} s: {late}; see {logs}")
            if missing:
                self._observer.on_phase(f"{len(names) - len(missing)} of {len(names)} processes are ready")

    async def _watch_clock(self) -> Ending:
        """Wait for the end of the run; give it up when time stands still."""
        loop = asyncio.get_running_loop()
        self._last_tick = loop.time()
        patience_s = patience_of(self._scenario)
        while True:
            await asyncio.sleep(1.0)
            silence_s = loop.time() - self._last_tick
            if silence_s > patience_s:
                raise FleetError(
                    f"sim time has stood at {self.sim_time_ns / 1e9:.2f} s for {silence_s:.0f} s\n{self._tails()}"
                )

    def _tails(self) -> str:
        """The last line of each log that may tell why time stands still."""
        told = [
            c for c in self._children if c.spec.name.startswith(("router", "physics", "autopilot", "host"))
        ]
        return "\n".join(f"{child.spec.log_path}: {child.log_tail(1)}" for child in told)


async def _connect(endpoint: str, credentials: Credentials) -> Session:
    """Join the router once it listens, in short tries, so that an interrupted start ends soon."""
    deadline = asyncio.get_running_loop().time() + START_S
    while True:
        try:
            return await asyncio.to_thread(open_client, endpoint, credentials, timeout_s=0.5)
        except SessionError as error:
            if asyncio.get_running_loop().time() > deadline:
                raise FleetError(str(error)) from error


def patience_of(scenario: Scenario) -> float:
    """How long, in wall time, sim time may stand still: longer than an autopilot may owe its packet."""
    if scenario.autopilot == "external":
        return float("inf")
    return max(SILENCE_S, 2 * scenario.fdm.stall_timeout_s)


def launcher_of(scenario: Scenario, ardupilot_dir: Path | None = None) -> Launcher:
    """The source of autopilots that the scenario names."""
    return LAUNCHERS[scenario.autopilot](os.environ, ardupilot_dir)


def preflight(scenario: Scenario, ardupilot_dir: Path | None = None) -> None:
    """See, before anything is started, that the run can start.

    Raises:
        FleetError: if a port is taken, or an autopilot or a wind map is missing; the text says what to do.
    """
    try:
        wind_of(scenario).build(seed=scenario.seed, ua_id=0)
    except WindError as error:
        raise FleetError(f"wind: {error}") from error
    launcher = launcher_of(scenario, ardupilot_dir)
    try:
        for ua in scenario.ua:
            launcher.check(scenario, ua)
    except AutopilotError as error:
        raise FleetError(str(error)) from error
    taken = conflicts(ports_of(scenario))
    if taken:
        raise FleetError("\n".join(taken))
