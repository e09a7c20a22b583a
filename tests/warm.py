"""Commands `lostlink` that begin where everything is imported: forked from a process that waits for them.

A test that starts the command pays one to two CPU seconds for what Python imports, in two processes, and looks at
something else. `Command` and `run_lostlink` are what `subprocess.Popen` and `run` are to them, and `flown` what `fly`
is. How a command begins, and what it does in another environment or with other limits than those of the tests, is for
tests that start it anew.
"""

from __future__ import annotations

import atexit
import json
import os
import selectors
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import IO, Any

import yaml

from bridge.fleet.children.environment import of_runs
from bridge.fleet.children.forked import fork
from lostlink import Run, load_run
from lostlink.flight.scripted import read_like

NEEDED = (
    "bridge.program.process",
    "lostlink.cli.entry",
    "lostlink.flight.figure",
    "matplotlib.backends.backend_agg",
    "matplotlib.figure",
    "scipy.special",
)
ORDER_MAX_BYTES = 1 << 18
EXPECTATIONS_FAILED = 3
"""Exit status of a run that is whole."""
STATUS_BYTES = 4


LOSTLINK = (sys.executable, "-m", "lostlink")
_OURS = dict(os.environ)
"""The environment that the tests began with."""
OF_NO_RUN = ("PYTEST_", "MAVLINK_", "RUST_LOG")
"""Variables that pytest, pymavlink and a guarded router in our process set for themselves."""


def is_as_ever() -> bool:
    """Whether the environment is the one that commands are forked in."""
    differs = {name for name in {*_OURS, *os.environ} if _OURS.get(name) != os.environ.get(name)}
    return all(name.startswith(OF_NO_RUN) for name in differs)


class Command:
    """A `lostlink` in the background, as `subprocess.Popen` has it.

    Args:
        words: its command line, without the program.
        stdin, stdout, stderr: files, `subprocess.PIPE` (but for stdin), DEVNULL, STDOUT; ours if not given.
        cwd: its directory.
        start_new_session: whether it is out of reach of what a terminal sends.
        text: whether its outputs are text.
        first: Python code that runs before it, in its process.
    """

    def __init__(
        self,
        *words: str | Path,
        stdin: IO[Any] | int | None = None,
        stdout: IO[Any] | int | None = None,
        stderr: IO[Any] | int | None = None,
        cwd: str | Path | None = None,
        start_new_session: bool = False,
        text: bool = False,
        first: str = "",
    ) -> None:
        self.args = ["lostlink", *map(str, words)]
        self.returncode: int | None = None
        self._text = text
        opened: list[int] = []
        fds = [_its_end(given, fd, opened) for fd, given in ((0, stdin), (1, stdout), (2, stderr))]
        ours: list[IO[Any] | None] = [None, None, None]
        for fd, given in ((1, stdout), (2, stderr)):
            if given == subprocess.PIPE:
                read, fds[fd] = os.pipe()
                opened.append(fds[fd])
                ours[fd] = os.fdopen(read, "r" if text else "rb")
        if stderr == subprocess.STDOUT:
            fds[2] = fds[1]
        _, self.stdout, self.stderr = ours
        self._told: dict[IO[Any], bytes] = {pipe: b"" for pipe in ours if pipe is not None}
        self._end, theirs = socket.socketpair()
        order = json.dumps([self.args, str(cwd or Path.cwd()), start_new_session, first]).encode()
        socket.send_fds(_nursery(), [order], [theirs.fileno(), *fds])
        theirs.close()
        for fd in opened:
            os.close(fd)
        told = self._end.recv(STATUS_BYTES, socket.MSG_WAITALL)
        if not told:
            _nursery.cache_clear()
            raise RuntimeError("the process that commands are forked from is gone")
        self.pid = int.from_bytes(told, "big")

    def wait(self, timeout: float | None = None) -> int:
        """Its exit status, or minus the signal that ended it."""
        if self.returncode is None:
            self._end.settimeout(timeout)
            try:
                told = self._end.recv(STATUS_BYTES, socket.MSG_WAITALL)
            except (TimeoutError, BlockingIOError) as error:
                raise subprocess.TimeoutExpired(self.args, timeout or 0.0) from error
            self._end.close()
            self.returncode = int.from_bytes(told, "big", signed=True) if told else -signal.SIGKILL
        return self.returncode

    def poll(self) -> int | None:
        """Its exit status, if it is over."""
        try:
            return self.wait(0.0)
        except subprocess.TimeoutExpired:
            return None

    def communicate(self, timeout: float | None = None) -> tuple[Any, Any]:
        """What it writes until its end."""
        until_s = None if timeout is None else time.monotonic() + timeout
        told = self._told
        with selectors.DefaultSelector() as selector:
            for pipe in told:
                if not pipe.closed:
                    selector.register(pipe, selectors.EVENT_READ)
            while selector.get_map():
                ready = selector.select(None if until_s is None else max(0.0, until_s - time.monotonic()))
                if not ready:
                    raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
                for key, _ in ready:
                    chunk = os.read(key.fd, 1 << 16)
                    told[key.fileobj] += chunk  # type: ignore[index]
                    if not chunk:
                        selector.unregister(key.fileobj)
                        key.fileobj.close()  # type: ignore[union-attr]
        self.wait(None if until_s is None else max(0.0, until_s - time.monotonic()))
        out, err = (None if pipe is None else told[pipe] for pipe in (self.stdout, self.stderr))
        if self._text:
            out, err = (None if each is None else each.decode() for each in (out, err))  # type: ignore[assignment]
        return out, err

    def send_signal(self, number: int) -> None:
        """Send it a signal, if it is not over."""
        if self.poll() is None:
            with suppress(ProcessLookupError):  # over, but not yet told
                os.kill(self.pid, number)

    def terminate(self) -> None:
        """Send it SIGTERM."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """Send it SIGKILL."""
        self.send_signal(signal.SIGKILL)


def run_lostlink(
    *words: str | Path,
    cwd: str | Path | None = None,
    timeout: float | None = None,
    check: bool = False,
    text: bool = True,
    first: str = "",
) -> subprocess.CompletedProcess[Any]:
    """Run a command to its end, as `subprocess.run` with its outputs captured; anew in an environment of its own.

    With Python code that runs ``first`` it is forked in any case.
    """
    if not first and not is_as_ever():
        command = [*LOSTLINK, *map(str, words)]
        return subprocess.run(command, capture_output=True, cwd=cwd, timeout=timeout, check=check, text=text)
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    begun = Command(*words, cwd=cwd, text=text, first=first, **pipes)  # type: ignore[arg-type]
    try:
        out, err = begun.communicate(timeout)
    except BaseException:
        begun.kill()
        begun.communicate()
        raise
    done = subprocess.CompletedProcess(begun.args, begun.wait(), out, err)
    if check:
        done.check_returncode()
    return done


def flown(scenario: Mapping[str, Any] | Path, directory: Path) -> Run:
    """The record of a flight, as `lostlink.fly` makes it.

    Raises:
        ScenarioError: as it does.
    """
    read_like(scenario, {})
    file = scenario if isinstance(scenario, Path) else directory.with_suffix(".yaml")
    if not isinstance(scenario, Path):
        file.write_text(yaml.safe_dump(dict(scenario), sort_keys=False), encoding="utf-8")
    done = run_lostlink("run", file, "--out", directory, "--speed", "max", "--no-figure", "--quiet")
    assert done.returncode in (0, EXPECTATIONS_FAILED), f"{done.returncode}: {done.stdout}{done.stderr}"
    return load_run(max(directory.iterdir()))


def _its_end(given: IO[Any] | int | None, fd: int, opened: list[int]) -> int:
    if given is None or given in (subprocess.PIPE, subprocess.STDOUT):
        return fd
    if given == subprocess.DEVNULL:
        opened.append(os.open(os.devnull, os.O_RDWR))
        return opened[-1]
    return given if isinstance(given, int) else given.fileno()


@cache
def _nursery() -> socket.socket:
    """Where orders go to."""
    orders, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    command = [sys.executable, "-P", "-c", "from tests.warm import main; main()", str(theirs.fileno())]
    environment = {**_OURS, **of_runs(_OURS), "PYTHONPATH": str(Path(__file__).parents[1])}
    process = subprocess.Popen(command, env=environment, pass_fds=[theirs.fileno()], start_new_session=True)
    theirs.close()
    atexit.register(lambda: (orders.close(), process.wait()))
    return orders


def main() -> None:
    """Fork a command for each order, until nobody can order any more."""
    for module in NEEDED:
        import_module(module)
    from lostlink.cli.main import COMMANDS

    for module in COMMANDS.values():
        import_module(module)
    orders = socket.socket(fileno=int(sys.argv[1]))
    running: dict[int, tuple[int, socket.socket]] = {}
    with selectors.DefaultSelector() as selector:
        selector.register(orders, selectors.EVENT_READ)
        while True:
            for key, _ in selector.select():
                if key.fileobj is orders:
                    order, fds, _, _ = socket.recv_fds(orders, ORDER_MAX_BYTES, 4)
                    if not order:
                        return
                    pid = fork(lambda order=order, fds=fds: _play(order, fds))  # type: ignore[misc]
                    told = socket.socket(fileno=fds[0])
                    _tell(told, pid)
                    for fd in fds[1:]:
                        os.close(fd)
                    running[watch := os.pidfd_open(pid)] = pid, told
                    selector.register(watch, selectors.EVENT_READ)
                else:
                    selector.unregister(key.fileobj)
                    pid, told = running.pop(key.fd)
                    os.close(key.fd)
                    status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
                    with told:
                        _tell(told, status)


def _tell(whoever: socket.socket, number: int) -> None:
    with suppress(OSError):  # nobody waits for it any more
        whoever.sendall(number.to_bytes(STATUS_BYTES, "big", signed=True))


def _play(order: bytes, fds: list[int]) -> int:
    """Be the command: with its files and directory, and with the end that any Python has."""
    words, cwd, session, first = json.loads(order)
    for standard, fd in enumerate(fds[1:]):
        os.dup2(fd, standard)
    os.closerange(3, 1 << 10)
    if session:
        os.setsid()
    os.chdir(cwd)
    sys.argv = words
    exec(first, {})
    from lostlink.cli.entry import main as command

    try:
        command()
    except SystemExit as end:
        if isinstance(end.code, str):
            print(end.code, file=sys.stderr)
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    finally:
        threading._shutdown()  # type: ignore[attr-defined]
        atexit._run_exitfuncs()
    return 0
