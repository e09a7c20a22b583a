"""The live view beside a command that flies: a process of its own, which no result depends on."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from importlib.util import find_spec
from typing import Self

from bridge.bus.session import free_port
from bridge.fleet.children.child import start_process
from bridge.fleet.preflight.ports import HOST, PortUse, conflicts
from bridge.run.directory import RunDirectory
from bridge.timeouts import VIEW_S

PORT = 8080
VIEW_LOG = "view"
"""Of the logs of a run."""
LOOK_AGAIN_S = 0.1
RUN_OPTION = "--view-port"
"""Of the commands that fly."""
END_S = 5.0
"""For the view to end after it was asked to."""


class NoView(RuntimeError):
    """The view cannot be served; the text says why, and what to do."""


class ViewProcess:
    """The view of a run; a context manager that ends it for sure.

    Args:
        port: to serve at; 0: any free one.
        control: whether viewers may command.

    Raises:
        NoView: a package is missing, or the port is taken.
    """

    def __init__(self, port: int, *, control: bool) -> None:
        check_installed()
        if port:
            taken = port_conflict(port, RUN_OPTION)
            if taken:
                raise NoView(taken)
        self.port, self._control = port or free_port(HOST), control
        self._process: subprocess.Popen[bytes] | None = None
        self._is_told = False

    @property
    def address(self) -> str:
        """What a browser is given."""
        return f"http://{HOST}:{self.port}/"

    def start(self, run: RunDirectory) -> None:
        """Serve the view of a run that is about to start; its output goes to a log of the run."""
        command = [
            sys.executable,
            "-P",
            "-m",
            "lostlink.cli.main",
            "view",
            str(run.path),
            "--port",
            str(self.port),
            "--token",
            "",  # of this machine alone, whatever the environment has
            "--wait",
        ]
        command += ["--control"] if self._control else []
        with run.log_path(VIEW_LOG).open("wb") as log:
            self._process = start_process(command, log)

    async def failures(self, run: RunDirectory, is_flying: Callable[[], bool]) -> AsyncIterator[str]:
        """What goes wrong with it, as soon as it does.

        The first is "" when it serves, and so has joined the run, or why it does not: it ended, or took VIEW_S.

        Args:
            run: that it shows.
            is_flying: asked when it has ended as if all were well, whether the run has not.
        """
        if await self._is_served(run):
            yield ""
        else:
            yield f"{self._why_not_served()}: the run begins without it; its log is {run.log_path(VIEW_LOG)}"
        while self.is_open:  # noqa: ASYNC110 - a process of subprocess has no event
            await asyncio.sleep(LOOK_AGAIN_S)
        if failure := self.failure(run):
            yield failure
        elif not self._is_told and is_flying():
            self._is_told = True
            yield "the view was asked to end: the run goes on without it"

    def _why_not_served(self) -> str:
        self._is_told = not self.is_open
        if not self._is_told:
            return f"the view is not served after {VIEW_S:g} s"
        taken = port_conflict(self.port, RUN_OPTION)
        return f"the view has ended, as {taken}" if taken else "the view has ended"

    async def _is_served(self, run: RunDirectory) -> bool:
        """Whether it says that it serves: that somebody listens at its port may be another than the view."""
        log = run.log_path(VIEW_LOG)
        with suppress(TimeoutError):
            async with asyncio.timeout(VIEW_S):
                while self.is_open:
                    if self.address in await asyncio.to_thread(log.read_text, errors="replace"):
                        return True
                    await asyncio.sleep(LOOK_AGAIN_S)
        return False

    @property
    def is_open(self) -> bool:
        """Whether it serves still."""
        return self._process is not None and self._process.poll() is None

    def failure(self, run: RunDirectory) -> str:
        """That it ended, if that was not because all was well, and nobody was told of it."""
        if self._is_told or self._process is None or not self._process.poll():
            return ""
        self._is_told = True
        return f"the view ended before the run; its log is {run.log_path(VIEW_LOG)}"

    def wait(self) -> None:
        """Wait until nobody looks any more: once the run is over the view ends by itself then."""
        if self._process is not None:
            self._process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process is None or not self.is_open:
            return
        self._process.send_signal(signal.SIGTERM)
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(END_S)
        self._process.kill()
        self._process.wait()


def port_conflict(port: int, option: str) -> str:
    """Who has the view's port, and what to do: another by ``option``; "" if it is free."""
    return "\n".join(conflicts([PortUse(port, "TCP", "live view", option)]))


def check_installed() -> None:
    """See that what the view needs is there.

    Raises:
        NoView: it is not.
    """
    if find_spec("nicegui") is None:
        raise NoView("the live view needs NiceGUI: pip install 'lostlink[view]'")
    import multiprocessing  # late: a run without a view needs none of it

    try:
        multiprocessing.Lock()  # of the processes that NiceGUI keeps
    except OSError as error:
        raise NoView(
            f"the live view needs shared memory, which /dev/shm has not: {error.strerror}"
        ) from error
