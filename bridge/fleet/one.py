"""A run of one process: its parts are one program (`bridge.program`), a child or a task of the supervisor's."""

from __future__ import annotations

import asyncio
import logging
import socket
import sys
from collections.abc import Callable
from contextlib import suppress

from bridge.bus.messages import Message
from bridge.bus.supervisor_socket import GO, SampleReader
from bridge.fleet.arrangement import Arrangement
from bridge.fleet.children.child import Child, ProcessSpec, end_all, end_with_news
from bridge.fleet.children.crew import Crew
from bridge.fleet.course import FleetError
from bridge.fleet.tidings import Tidings
from bridge.record.events import Report
from bridge.run.directory import RunDirectory
from bridge.run.process import NodeLogs
from bridge.timeouts import FLIGHT_GRACE_S, ROUTER_GRACE_S, START_S

NAME = "fleet"
MODULE = "bridge.program.process"
PROGRAM = (sys.executable, "-P", "-m", MODULE)
READ_BYTES = 1 << 16
log = logging.getLogger(NAME)


class _OneProgram(Arrangement):
    """The program."""

    recorder = NAME

    def __init__(
        self, run: RunDirectory, crew: Crew, tidings: Tidings, on_phase: Callable[[str], object]
    ) -> None:
        super().__init__(run, crew, tidings, on_phase)
        self._begun = asyncio.Event()
        on_phase("starts flight dynamics, radio and agents in one process")

    async def ready(self) -> None:
        """Wait until it is ready."""
        try:
            await asyncio.wait_for(self._begun.wait(), START_S)
        except TimeoutError:
            log_path = self._run.log_path(NAME)
            raise FleetError(f"not ready within {START_S:g} s: {NAME}; see {log_path}") from None

    def _heard(self, key: str, came: bytes | Message) -> None:
        if key == self._run.keys.alive(NAME):
            self._begun.set()
        else:
            self._sorter.take(key, came)


class OneProcess(_OneProgram):
    """The program as a child, which says what it does through a socket."""

    _child: Child | None = None
    _socket: socket.socket | None = None

    async def start(self) -> None:
        """Start the program."""
        self._samples, self._closed = SampleReader(), asyncio.Event()
        self._socket, theirs = socket.socketpair()
        self._socket.setblocking(False)
        asyncio.get_running_loop().add_reader(self._socket, self._read)
        with theirs:
            command = [*PROGRAM, "--run-dir", str(self._run.path), "--tell-fd", str(theirs.fileno())]
            command += ["--glance"] if self._tidings.glance is not None else []
            self._child = self._crew.start(
                ProcessSpec(NAME, command, self._run.log_path(NAME), pass_fds=(theirs.fileno(),))
            )

    def go(self) -> None:
        """Tell it to fly."""
        if self._socket is not None:
            with suppress(ConnectionError):  # it has ended
                self._socket.send(GO)

    def _read(self) -> None:
        assert self._socket is not None
        try:
            data = self._socket.recv(READ_BYTES)
        except BlockingIOError:
            return
        except ConnectionError:
            data = b""
        if not data:
            self._close()
        for key, payload in self._samples.receive(data):
            self._heard(key, payload)

    def _close(self) -> None:
        if self._socket is not None:
            asyncio.get_running_loop().remove_reader(self._socket)
            self._socket.close()
            self._socket = None
            self._closed.set()

    async def end(self, news: asyncio.Event) -> list[str]:
        """End the program, which writes what is left of its record, then the autopilots."""
        killed: list[str] = []
        if self._child is not None:
            killed += await end_with_news(self._child, news, ROUTER_GRACE_S)
            with suppress(TimeoutError):  # its last words, which may still be in the socket
                await asyncio.wait_for(self._closed.wait(), FLIGHT_GRACE_S)
        others = [child for child in self._crew.children if child is not self._child]
        killed += await end_all(others, FLIGHT_GRACE_S)
        self._close()
        return killed


class OneTask(_OneProgram):
    """The program as a task of the supervisor's own event loop: its process was started with the run's environment."""

    _task: asyncio.Task[None] | None = None

    async def start(self) -> None:
        """Start the program."""
        from bridge.host.offspring import Offspring
        from bridge.program.process import fly  # which loads all parts

        self._go, self._stop = asyncio.Event(), asyncio.Event()
        self._logs = NodeLogs(self._run, logging.FileHandler(self._run.log_path(NAME), encoding="utf-8"))
        root = logging.getLogger()
        root.setLevel(logging.INFO)
        root.addHandler(self._logs)
        self._offspring = Offspring(Report(self._run.path, NAME))
        looks = self._tidings.glance is not None
        flight = fly(self._run, self._heard, self._go.wait, self._stop, looks=looks)
        self._task = asyncio.create_task(flight, name=NAME)
        self._task.add_done_callback(self._ended)

    def go(self) -> None:
        """Let it fly."""
        self._go.set()

    def _ended(self, task: asyncio.Task[None]) -> None:
        error = None if task.cancelled() else task.exception()
        if error is not None:
            log.error("the run cannot go on", exc_info=error)
            self._tidings.lost(f"the run cannot go on: {error}")
        self._begun.set()

    async def end(self, news: asyncio.Event) -> list[str]:  # noqa: ARG002
        """End the program, which writes what is left of its record, then the autopilots."""
        if self._task is not None:
            self._stop.set()
            await asyncio.wait({self._task})
        killed = await end_all(self._crew.children, FLIGHT_GRACE_S)
        if self._task is not None:
            self._offspring.end()  # the autopilots are children of this process, too
            logging.getLogger().removeHandler(self._logs)
            self._logs.close()
        return killed
