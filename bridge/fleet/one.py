"""A run of one process: its parts are one program (`bridge.program`), a child or a task of the supervisor's."""

from __future__ import annotations

import asyncio
import logging
import os
import sys
from collections.abc import Callable
from contextlib import suppress

from bridge.bus.messages import Message, encode
from bridge.bus.pipe import PipeReader
from bridge.fleet.child import Child, ProcessSpec, end_all, end_with_news
from bridge.fleet.course import FleetError
from bridge.fleet.crew import Crew
from bridge.fleet.tidings import SampleSorter, Tidings
from bridge.run.directory import RunDirectory
from bridge.run.process import NodeLogs
from bridge.timeouts import FLIGHT_GRACE_S, ROUTER_GRACE_S, START_S

NAME = "fleet"
READ_BYTES = 1 << 16
log = logging.getLogger(NAME)


class OneProcess:
    """The program as a child, which tells what it does through a pipe (`bridge.fleet.arrangement.Arrangement`).

    Args:
        run: the run.
        crew: starts it.
        tidings: told what it says.
        on_phase: told what is waited for.
    """

    recorder = NAME

    def __init__(
        self, run: RunDirectory, crew: Crew, tidings: Tidings, on_phase: Callable[[str], object]
    ) -> None:
        self._run, self._crew, self._on_phase = run, crew, on_phase
        self._delivery = SampleSorter(run.keys, tidings)
        self._samples = PipeReader()
        self._child: Child | None = None
        self._alive = asyncio.Event()
        self._closed = asyncio.Event()
        self._fd = -1
        self.failed = 0

    async def start(self) -> None:
        """Start the program.

        Raises:
            FleetError: it cannot be started.
        """
        self._on_phase("starts flight dynamics, radio and agents in one process")
        self._fd, theirs = os.pipe()
        os.set_blocking(self._fd, False)
        asyncio.get_running_loop().add_reader(self._fd, self._read)
        command = [sys.executable, "-m", "bridge.program.process", "--run-dir", str(self._run.path)]
        spec = ProcessSpec(
            NAME, [*command, "--tell-fd", str(theirs)], self._run.log_path(NAME), pass_fds=(theirs,)
        )
        try:
            self._child = await self._crew.start(spec)
        finally:
            os.close(theirs)

    async def ready(self) -> None:
        """Wait until it is ready.

        Raises:
            FleetError: it is not in time.
        """
        try:
            await asyncio.wait_for(self._alive.wait(), START_S)
        except TimeoutError:
            log = self._run.log_path(NAME)
            raise FleetError(f"not ready within {START_S:g} s: {NAME}; see {log}") from None

    def go(self) -> None:
        """It flies as soon as it is ready: nobody else need be waited for."""

    def _read(self) -> None:
        try:
            data = os.read(self._fd, READ_BYTES)
        except BlockingIOError:
            return
        if not data:
            self._close()
        for key, payload in self._samples.receive(data):
            if key == self._run.keys.alive(NAME):
                self._alive.set()
            else:
                self._delivery.take(key, payload)

    def _close(self) -> None:
        if self._fd >= 0:
            asyncio.get_running_loop().remove_reader(self._fd)
            os.close(self._fd)
            self._fd = -1
            self._closed.set()

    async def end(self, news: asyncio.Event) -> list[str]:
        """End the program, which writes what is left of its record, then the autopilots.

        Returns:
            The names of those that had to be killed.
        """
        killed: list[str] = []
        if self._child is not None:
            killed += await end_with_news(self._child, news, ROUTER_GRACE_S)
            with suppress(TimeoutError):  # its last words, which may still be in the pipe
                await asyncio.wait_for(self._closed.wait(), FLIGHT_GRACE_S)
        others = [child for child in self._crew.children if child is not self._child]
        killed += await end_all(others, FLIGHT_GRACE_S)
        self._close()
        return killed


class OneTask:
    """The program as a task of the supervisor's own event loop: its process was started with the run's environment."""

    recorder = NAME
    failed = 0

    def __init__(
        self, run: RunDirectory, crew: Crew, tidings: Tidings, on_phase: Callable[[str], object]
    ) -> None:
        self._run, self._crew, self._tidings = run, crew, tidings
        self._delivery = SampleSorter(run.keys, tidings)
        self._stop, self._begun = asyncio.Event(), asyncio.Event()
        self._on_phase = on_phase
        self._task: asyncio.Task[None] | None = None

    async def start(self) -> None:
        """Start the program."""
        from bridge.program.process import fly  # which loads all parts

        self._on_phase("starts flight dynamics, radio and agents")
        self._logs = NodeLogs(self._run, logging.FileHandler(self._run.log_path(NAME), encoding="utf-8"))
        root = logging.getLogger()
        root.setLevel(logging.INFO)
        root.addHandler(self._logs)
        self._task = asyncio.create_task(fly(self._run, self._tell, self._stop), name=NAME)
        self._task.add_done_callback(self._ended)

    def _tell(self, key: str, message: Message) -> None:
        if key == self._run.keys.alive(NAME):
            self._begun.set()
        else:
            self._delivery.take(key, encode(message))

    def _ended(self, task: asyncio.Task[None]) -> None:
        error = None if task.cancelled() else task.exception()
        if error is not None:
            log.error("the run cannot go on", exc_info=error)
            self._tidings.lost(f"the run cannot go on: {error}")
        self._begun.set()

    async def ready(self) -> None:
        """Wait until it is ready.

        Raises:
            FleetError: it is not in time.
        """
        try:
            await asyncio.wait_for(self._begun.wait(), START_S)
        except TimeoutError:
            log_path = self._run.log_path(NAME)
            raise FleetError(f"not ready within {START_S:g} s: {NAME}; see {log_path}") from None

    def go(self) -> None:
        """It flies as soon as it is ready."""

    async def end(self, news: asyncio.Event) -> list[str]:  # noqa: ARG002
        """End the program, which writes what is left of its record, then the autopilots."""
        self._stop.set()
        if self._task is not None:
            await asyncio.wait({self._task})
            logging.getLogger().removeHandler(self._logs)
            self._logs.close()
        return await end_all(self._crew.children, FLIGHT_GRACE_S)
