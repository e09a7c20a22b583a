"""A run of many processes: router, physics and hosts, joined by Zenoh."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import partial

from bridge.bus.identity.roster import SUPERVISOR
from bridge.bus.inbox import Inbox
from bridge.bus.messages import Header
from bridge.bus.session import Sample, Session, SessionError, open_client
from bridge.fleet.arrangement import Arrangement
from bridge.fleet.children.child import Child, ProcessSpec, end_all, end_with_news
from bridge.fleet.children.crew import Crew
from bridge.fleet.course import FleetError
from bridge.fleet.hosts import PREFIX
from bridge.fleet.own_thread import in_own_thread
from bridge.fleet.tidings import Tidings
from bridge.run.directory import RunDirectory
from bridge.timeouts import AGENT_GRACE_S, FLIGHT_GRACE_S, NEWS_PERIOD_S, ROUTER_GRACE_S, START_S

MODULES = {
    "router": "bridge.radio.router.process",
    "physics": "bridge.physics.process",
    "host": "bridge.host.process",
}
"""What runs as which process."""
RECORDER = "router"
"""The process that writes the last part of the record."""


def modules_of(hosts: Iterable[str]) -> dict[str, str]:
    """The module of each process of ours by the process's name, with those of the hosts."""
    ours = {name: MODULES[name] for name in ("router", "physics")}
    return ours | dict.fromkeys(hosts, MODULES["host"])


class ManyProcesses(Arrangement):
    """The processes of a run, which report on Zenoh what they do."""

    recorder = RECORDER

    def __init__(
        self, run: RunDirectory, crew: Crew, tidings: Tidings, on_phase: Callable[[str], object]
    ) -> None:
        super().__init__(run, crew, tidings, on_phase)
        self._router: Child | None = None
        self._session: Session | None = None
        self._names: set[str] = set()
        # What decides the run is never dropped.
        self._inbox: Inbox[Sample] = Inbox(asyncio.get_running_loop(), self._sort, limit=None)

    async def start(self) -> None:
        """Start our own processes, all at once."""
        self._on_phase("starts the radio router")
        self._router = self._crew.start(self._python("router"))
        self._on_phase("starts flight dynamics, MAVLink daemons and agents")
        specs = [self._python("physics")]
        specs += [self._python("host", name, nodes) for name, nodes in self._run.info.hosts.items()]
        for spec in specs:
            self._crew.start(spec)
        self._names = {"router", *(spec.name for spec in specs)}

    def _python(self, module: str, name: str = "", nodes: Sequence[str] = ()) -> ProcessSpec:
        name = name or module
        command = [
            sys.executable,
            "-P",
            "-m",
            MODULES[module],
            "--run-dir",
            str(self._run.path),
            "--name",
            name,
        ]
        command += ["--nodes", ",".join(nodes)] if nodes else []
        return ProcessSpec(name, command, self._run.log_path(name))

    async def ready(self) -> None:
        """Join the router, and wait until all are ready."""
        self._session = await self._connected()
        self._listen(self._session)
        await self._all_alive(self._session)

    async def _connected(self) -> Session:
        """Join the router once it listens, in short tries, so that an interrupted start ends soon."""
        endpoint, credentials = self._run.info.endpoint, self._run.credentials(SUPERVISOR)
        deadline = asyncio.get_running_loop().time() + START_S
        while True:
            try:
                return await in_own_thread(partial(open_client, endpoint, credentials, timeout_s=0.5))
            except SessionError as error:
                if asyncio.get_running_loop().time() > deadline:
                    raise FleetError(str(error)) from error

    def _listen(self, session: Session) -> None:
        keys = self._run.keys
        told = (keys.clock, keys.clock_end, keys.clock_pace, keys.agent("*"), keys.warning("*"), keys.ending)
        for key in told:
            session.subscribe(key, self._inbox.push)
        if self._tidings.glance is not None:  # which costs next to nothing, in any thread
            for key in (keys.state("*"), keys.tick("links")):
                session.subscribe(key, self._sort)

    def _sort(self, sample: Sample) -> None:
        self._sorter.take(str(sample.key_expr), sample.payload.to_bytes())

    async def _all_alive(self, session: Session) -> None:
        everybody = asyncio.Event()
        keys, missing = self._run.keys, set(self._names)

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
                ready = len(self._names) - len(missing)
                self._on_phase(f"{ready} of {len(self._names)} processes are ready")

    def go(self) -> None:
        """From now on physics answers autopilots."""
        assert self._session is not None
        self._session.put(self._run.keys.clock_start, Header(), must_arrive=True)

    async def end(self, news: asyncio.Event) -> list[str]:
        """End everything: hosts first, so that nobody transmits into a dying router; the router last."""
        children = self._crew.children
        hosts = [child for child in children if child.spec.name.startswith(PREFIX)]
        others = [c for c in children if c not in hosts and c is not self._router]
        killed = await end_all(hosts, AGENT_GRACE_S) + await end_all(others, FLIGHT_GRACE_S)
        if self._router is not None:
            killed += await end_with_news(self._router, news, ROUTER_GRACE_S)
        if self._session is not None:
            self._session.close()
        return killed
