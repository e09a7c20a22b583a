"""Starts another program of this package, and says how a process ended."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

OURS = str(Path(__file__).resolve().parents[1])
"""Where this package is: before what the program has on its path, as files there may have our names."""


def start_module(
    module: str, arguments: Sequence[int], pass_fds: Sequence[int], *, own_session: bool = False
) -> subprocess.Popen[bytes]:
    """A process of its own that runs a module, and no fork of this one, which may have threads.

    Args:
        module: its full name.
        arguments: of its command line.
        pass_fds: file descriptors that it keeps.
        own_session: the terminal's signals, such as Ctrl-C, do not reach it.

    Raises:
        OSError: it cannot be started.
    """
    return subprocess.Popen(
        [sys.executable, "-P", "-m", module, *map(str, arguments)],
        pass_fds=pass_fds,
        stdin=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": os.pathsep.join((OURS, *filter(None, sys.path)))},
        start_new_session=own_session,
    )


def how_it_ended(status: int) -> str:
    """Exit status, or minus the signal that ended it, in words; real-time signals have numbers alone."""
    if status >= 0:
        return f"ended with status {status}"
    names = {number.value: number.name for number in signal.Signals}
    return f"was ended by {names.get(-status, f'signal {-status}')}"
