"""Child processes of the supervisor: started apart from the terminal, and ended for sure."""

from __future__ import annotations

import asyncio
import json
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO, Protocol

from bridge.fleet.children.environment import environment_of
from bridge.fleet.children.last_words import last_words
from bridge.timeouts import STACKS_S
from fdm.module_process import how_it_ended
from sitl_configs.own_code import PATH_VARIABLE, path_of_others

LEASH = Path(__file__).with_name("leash.py")
LAST_WORDS = " ERROR lostlink: "
"""In a log, before what a process of ours says of an error that a user can mend."""
TAIL_BYTES = 1 << 14
"""So much of a log is looked at for its last lines."""


@dataclass(frozen=True, slots=True)
class ProcessSpec:
    """What to start.

    Attributes:
        name: for messages, the log's name and the liveliness token.
        command: program and arguments.
        log_path: where its output goes.
        cwd: its working directory; None for ours.
        stop_signal: how it is asked to end.
        pass_fds: file descriptors that it inherits.
        environment: variables that it has besides those of a run.
    """

    name: str
    command: Sequence[str]
    log_path: Path
    cwd: Path | None = None
    stop_signal: signal.Signals = signal.SIGTERM
    pass_fds: tuple[int, ...] = ()
    environment: Mapping[str, str] = field(default_factory=dict)


def start_process(
    command: Sequence[str],
    log: BinaryIO | None = None,
    cwd: Path | None = None,
    pass_fds: Sequence[int] = (),
    environment: Mapping[str, str] = MappingProxyType({}),
) -> subprocess.Popen[bytes]:
    """Start a process of ours or an autopilot, in the environment of a run; imports of ours look where they do here.

    The kernel ends it with the thread that calls this, where it can (see leash.py). Ctrl-C does not reach it: whoever
    started it ends it, in order.

    Args:
        command: program and arguments.
        log: where its output goes; None: it is spoken to and heard through pipes.
        cwd: its working directory; None for ours.
        pass_fds: file descriptors that it inherits.
        environment: variables that it has besides those of a run.

    Raises:
        OSError: its working directory is not there.
    """
    return subprocess.Popen(
        on_a_leash(command),
        stdin=subprocess.PIPE if log is None else subprocess.DEVNULL,
        stdout=subprocess.PIPE if log is None else log,
        stderr=None if log is None else subprocess.STDOUT,
        cwd=cwd,
        env={**environment_of(os.environ), PATH_VARIABLE: json.dumps(path_of_others()), **environment},
        pass_fds=pass_fds,
        start_new_session=True,
    )


class Started(Protocol):
    """A process that runs, as `subprocess.Popen` has it."""

    pid: int
    returncode: int | None

    def wait(self) -> int:
        """Wait for its end; returns its status."""

    def send_signal(self, sig: int, /) -> None:
        """Send it a signal, if it runs."""

    def kill(self) -> None:
        """End it at once."""


Start = Callable[["ProcessSpec", BinaryIO], Started]
"""Starts what a spec says, with its log."""


def start_anew(spec: ProcessSpec, log: BinaryIO) -> Started:
    """Start the command of a spec."""
    return start_process(spec.command, log, spec.cwd, spec.pass_fds, spec.environment)


class Child:
    """A child process, started by making this.

    Args:
        spec: what to start; its output goes to its log.
        start: starts it.

    Attributes:
        ended: done when it has ended, in the event loop in which it was started.

    Raises:
        OSError: its working directory is not there, or its log cannot be written.
    """

    def __init__(self, spec: ProcessSpec, start: Start = start_anew) -> None:
        self.spec = spec
        self._loop = asyncio.get_running_loop()
        self.ended: asyncio.Future[None] = self._loop.create_future()
        with spec.log_path.open("wb") as log:
            self._process = start(spec, log)
        threading.Thread(target=self._wait, name=f"wait for {spec.name}", daemon=True).start()

    def _wait(self) -> None:
        self._process.wait()
        with suppress(RuntimeError):  # the loop is closed: nobody wants to know
            self._loop.call_soon_threadsafe(self._has_ended)

    def _has_ended(self) -> None:
        if not self.ended.done():
            self.ended.set_result(None)

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def how_it_ended(self) -> str:
        """Exit status or signal, in words."""
        status = self._process.returncode
        return "still runs" if status is None else how_it_ended(status)

    @property
    def why_it_ended(self) -> str:
        """What a process of ours that cannot go on said last (`exit_status`); "" if it said nothing."""
        return "".join(self._log_end().rstrip().splitlines()[-1:]).partition(LAST_WORDS)[2]

    def ask_to_end(self) -> None:
        """Send its stop signal."""
        self._process.send_signal(self.spec.stop_signal)

    def says_where(self) -> bool:
        """Have a process of ours write the stacks of its threads to its log (`log_to_files`); whether it is one."""
        if not _catches(self.pid, signal.SIGUSR1):
            return False
        self._process.send_signal(signal.SIGUSR1)
        return True

    def kill(self) -> None:
        """End it at once, and what it has started."""
        import psutil  # late: few have to be killed

        started: list[psutil.Process] = []
        with suppress(psutil.Error):
            started = psutil.Process(self.pid).children(recursive=True)
        self._process.kill()
        for process in started:
            with suppress(psutil.Error):
                process.kill()

    def last_words(self, lines: int = 5) -> str:
        """What the end of its log says went wrong; "" if it says nothing, or somebody has removed it."""
        return last_words(self._log_end(), lines)

    def _log_end(self) -> str:
        """The end of its log, which may be of any size; "" if somebody has removed it."""
        try:
            with self.spec.log_path.open("rb") as log:
                log.seek(max(0, log.seek(0, os.SEEK_END) - TAIL_BYTES))
                return log.read().decode(errors="replace")
        except OSError:
            return ""


def _catches(pid: int, number: signal.Signals) -> bool:
    """Whether a process has a handler for a signal, as far as the kernel says so."""
    try:
        status = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    except OSError:
        return False
    caught = re.search(r"^SigCgt:\s*([0-9a-f]+)$", status, re.MULTILINE)
    return caught is not None and bool(int(caught[1], 16) >> (number - 1) & 1)


def on_a_leash(command: Sequence[str]) -> list[str]:
    """The command such that the kernel ends it with us, where the kernel can (see leash.py)."""
    if sys.platform != "linux":
        return list(command)
    # -I -S: a bare interpreter, gone within 20 ms, that looks at neither environment nor site packages.
    return [sys.executable, "-I", "-S", str(LEASH), str(os.getpid()), *command]


async def end_all(children: Sequence[Child], grace_s: float) -> list[str]:
    """Ask all to end, wait ``grace_s`` (wall time), kill those that are left, whose logs have what they were at.

    Returns:
        The names of the killed.
    """
    for child in children:
        child.ask_to_end()
    waiting = [child.ended for child in children]
    if waiting:
        await asyncio.wait(waiting, timeout=grace_s)
    late = [child for child in children if not child.ended.done()]
    if [child for child in late if child.says_where()]:
        await asyncio.sleep(STACKS_S)
    for child in late:
        child.kill()
    await asyncio.gather(*waiting)
    return [child.spec.name for child in late]


async def end_with_news(child: Child, news: asyncio.Event, patience_s: float) -> list[str]:
    """Ask a process to end that has much to do first: it has time as long as ``news`` comes within ``patience_s``.

    Returns:
        Its name if it had to be killed.
    """
    child.ask_to_end()
    while not child.ended.done():
        news.clear()
        heard = asyncio.create_task(news.wait())
        either: set[asyncio.Future[Any]] = {child.ended, heard}
        await asyncio.wait(either, timeout=patience_s, return_when=asyncio.FIRST_COMPLETED)
        heard.cancel()
        if not child.ended.done() and not news.is_set():
            return await end_all([child], 0.0)
    return []
