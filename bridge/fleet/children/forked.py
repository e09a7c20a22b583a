"""A child that is forked from a process of ours, which then has one thread and the environment of a run.

What is imported is imported once. A process with threads is not forked: a lock that another thread holds would stay
locked in the child for ever.
"""

from __future__ import annotations

import atexit
import gc
import json
import os
import signal
import socket
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, NoReturn, Self

from bridge.fleet.children.child import ProcessSpec
from bridge.fleet.children.environment import environment_of, has_environment
from bridge.fleet.children.leash import end_with_parent

ENDING = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
ORDER_MAX_BYTES = 1 << 16
ORDERS_FD = 3
Play = Callable[[Sequence[str]], int]
"""What a program does, given the words of its command line; returns its exit status."""


def fork(body: Callable[[], int]) -> int:
    """Run ``body`` in a child, which ends with the status that it returns, and with us.

    The child has none of our handlers of `ENDING`: those signals end it.

    Returns:
        Its process id.
    """
    parent = os.getpid()
    _flush()  # else the child would write it, too
    held = signal.pthread_sigmask(
        signal.SIG_BLOCK, ENDING
    )  # a signal is for the child, from its first moment on
    child = os.fork()
    if child == 0:
        _be_a_child(body, parent)
    signal.pthread_sigmask(signal.SIG_SETMASK, held)
    return child


def _be_a_child(body: Callable[[], int], parent: int) -> NoReturn:
    status = 1
    gc.freeze()  # what is our parent's is no garbage of ours, and looking through it would copy it
    try:
        for number in ENDING:
            if signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
        end_with_parent()
        if os.getppid() != parent:
            os._exit(1)  # it was gone before the wish was made
        status = body()
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        _flush()
        os._exit(status)


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            with suppress(OSError, ValueError):
                stream.flush()


def can_fork() -> bool:
    """Whether this process may be forked, and its child be a part of a run.

    The interpreter may have been told to look at no environment (``-I``), or to leave out assertions. GDAL, which reads
    terrain, hangs in the child of a process that has used it.
    """
    if "rasterio" in sys.modules:
        return False
    as_in_runs = has_environment(os.environ) and not sys.flags.hash_randomization and not sys.flags.optimize
    return sys.platform == "linux" and threading.active_count() == 1 and as_in_runs


class Understudy:
    """A child that waits to be a process of a run.

    Args:
        skipped: how many words of a command are there already: interpreter and program.
        load: loads the program, in the child.

    Attributes:
        pid: its process id.
        returncode: its exit status, or minus the signal that ended it; None while it runs.
    """

    def __init__(self, skipped: int, load: Callable[[], Play]) -> None:
        self._skipped, self._load = skipped, load
        self._orders, self._theirs = socket.socketpair()
        self.pid = fork(self._wait_for_orders)
        self._theirs.close()
        self.returncode: int | None = None

    def _wait_for_orders(self) -> int:
        os.setsid()
        atexit._clear()
        os.dup2(self._theirs.fileno(), ORDERS_FD)
        for number in [int(each.name) for each in Path("/proc/self/fd").iterdir()]:
            if number > ORDERS_FD:
                with suppress(OSError):  # that of the listing
                    os.close(number)  # it is our parent's
        play, failure = self._loaded()
        with socket.socket(fileno=ORDERS_FD) as orders:
            order, fds, _, _ = socket.recv_fds(orders, ORDER_MAX_BYTES, 2)
        if not order:
            return 0
        words, name, *inherited = json.loads(order)
        _take_files(fds, inherited)
        with suppress(OSError):  # for people: its command line is its parent's
            Path("/proc/self/comm").write_text(name, encoding="utf-8")
        if play is None:
            raise failure or AssertionError
        for variable in os.environ.keys() - environment_of(os.environ).keys():
            del os.environ[variable]
        try:
            return play(words)
        finally:  # as at the end of any Python
            threading._shutdown()  # type: ignore[attr-defined]
            atexit._run_exitfuncs()

    def _loaded(self) -> tuple[Play | None, BaseException | None]:
        """The program, or why it cannot be loaded: which is told in its log, once it has one."""
        try:
            return self._load(), None
        except Exception as error:
            return None, error

    def begin(self, spec: ProcessSpec, log: BinaryIO) -> Self:
        """Have it be the process of ``spec``, which inherits one file at most."""
        order = json.dumps([list(spec.command[self._skipped :]), spec.name, *spec.pass_fds]).encode()
        socket.send_fds(self._orders, [order], [log.fileno(), *spec.pass_fds])
        self._orders.close()
        return self

    def wait(self) -> int:
        """Wait for its end; returns its status."""
        _, status = os.waitpid(self.pid, 0)
        self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def send_signal(self, sig: int, /) -> None:
        """Send it a signal, if it runs."""
        if self.returncode is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, sig)

    def kill(self) -> None:
        """End it at once."""
        self.send_signal(signal.SIGKILL)

    def dismiss(self) -> None:
        """If it waits still, it ends: it has done nothing yet."""
        if self._orders.fileno() >= 0:
            self.kill()  # and not by the end of its orders
            self._orders.close()
            self.wait()


def _take_files(came: Sequence[int], inherited: Sequence[int]) -> None:
    """Log to the first of the files, read nothing, and have the others at the numbers that they have in the command."""
    log, *others = came
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    for standard in (1, 2):
        os.dup2(log, standard)
    os.close(log)
    for told, wanted in zip(others, inherited, strict=True):
        if told != wanted:
            os.dup2(told, wanted)
            os.close(told)
