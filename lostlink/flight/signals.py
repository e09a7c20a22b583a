"""The signals that end a command in order, and what is left to print to when its terminal has gone."""

from __future__ import annotations

import os
import signal
import stat
from collections.abc import Iterator
from contextlib import contextmanager


def ending_signals() -> tuple[signal.Signals, ...]:
    """Ctrl-C, a polite end, and a terminal that goes, unless that is to be outlived (`nohup`)."""
    signals = (signal.SIGINT, signal.SIGTERM)
    is_outlived = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    return signals if is_outlived else (*signals, signal.SIGHUP)


def hold_signals() -> None:
    """Have them wait until `heed_signals`, also in the program that replaces this one."""
    signal.pthread_sigmask(signal.SIG_BLOCK, ending_signals())


@contextmanager
def signals_held() -> Iterator[None]:
    """Have them wait until `heed_signals`, or the end of this."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ending_signals())
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def heed_signals() -> None:
    """Take them from now on, and those that waited."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ending_signals())


def leave_terminal() -> None:
    """If the terminal has gone, send what is still printed nowhere: it would be an error that ends the summary."""
    for fd in (1, 2):
        if _is_gone(fd):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, fd)
            os.close(nowhere)


def _is_gone(fd: int) -> bool:
    """Whether it was a terminal; one that was never open, or closed on purpose, was none."""
    try:
        return stat.S_ISCHR(os.fstat(fd).st_mode) and not os.isatty(fd)
    except OSError:
        return False
