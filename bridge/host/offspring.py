"""Processes that the code of agents starts: they end with the run."""

from __future__ import annotations

import ctypes
import logging
import sys
from contextlib import suppress
from time import monotonic, sleep

import psutil

from bridge.record.events import PROCESS_LEFT, Report
from bridge.run.process import log_clock
from bridge.timeouts import OFFSPRING_END_S

PR_SET_CHILD_SUBREAPER = 36
LOOK_S = 0.01
COMMAND_MAX = 80
"""Characters of a command that are told."""
log = logging.getLogger("host")


class Offspring:
    """What is started, from now on, by this process, and by what it has started.

    Where the kernel can (prctl(2), PR_SET_CHILD_SUBREAPER), also what its parent has left behind.

    Args:
        report: told what had to be ended.
    """

    def __init__(self, report: Report) -> None:
        self._report = report
        if sys.platform == "linux":
            ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        self._before = set(_running())

    def end(self) -> None:
        """Ask what still runs to end, and kill what has not ended `OFFSPRING_END_S` later (wall time)."""
        left = self._left()
        if not left:
            return  # each look reads all of /proc
        for process in left:
            text = f"a process that an agent had started was ended with the run: {_command_of(process)}"
            log.warning("%s", text)
            self._report.event(log_clock.now_ns or 0, "", PROCESS_LEFT, text)
        self._report.flush()
        for end in (psutil.Process.terminate, psutil.Process.kill):
            for process in self._left():
                with suppress(psutil.Error):
                    end(process)
            until = monotonic() + OFFSPRING_END_S
            while self._left() and monotonic() < until:
                sleep(LOOK_S)

    def _left(self) -> list[psutil.Process]:
        tracker = _tracker_pid()
        return [each for each in _running() if each not in self._before and each.pid != tracker]


def _running() -> list[psutil.Process]:
    """The descendants of this process, but for those that have ended and nobody has waited for."""
    return [each for each in psutil.Process().children(recursive=True) if _runs(each)]


def _tracker_pid() -> int | None:
    """Of what `multiprocessing` starts by itself: it ends with this process, and then removes what others have left."""
    module = sys.modules.get("multiprocessing.resource_tracker")
    return getattr(getattr(module, "_resource_tracker", None), "_pid", None)


def _runs(process: psutil.Process) -> bool:
    try:
        return process.status() != psutil.STATUS_ZOMBIE
    except psutil.Error:
        return False


def _command_of(process: psutil.Process) -> str:
    """For people: its beginning, in what UTF-8 has."""
    try:
        command = " ".join(" ".join(process.cmdline()).split()) or process.name()
    except psutil.Error:
        command = "?"
    printable = command.encode(errors="backslashreplace").decode()
    return f"{printable[:COMMAND_MAX]} (pid {process.pid})"
