"""Keeps an autopilot with many threads on one core, where they run one after the other.

PX4's threads that one frame wakes run at the same time on different cores, and which one is first is the machine's
choice: no two flights are alike. On one core their order is that of their priorities and of their waking, if PX4 may
have real-time threads (it asks for them, which takes root, CAP_SYS_NICE or `ulimit -r 99`); otherwise the kernel shares
the core out between them, by wall time.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from contextlib import suppress

from fdm.exchange.px4.quiet import PROC, thread_ids, thread_name

_IN_ORDER = ("SCHED_FIFO", "SCHED_RR")


def our_cores() -> tuple[int, ...]:
    """The cores that this thread may use, sorted; none where the system has no such call."""
    return tuple(sorted(os.sched_getaffinity(0))) if hasattr(os, "sched_getaffinity") else ()


def their_cores(cores: Sequence[int]) -> Sequence[int]:
    """Of the cores that an exchange may use, those for its PX4s: all but the first, if there are others.

    On a core that it shared with them the exchange would stand still whenever one of their threads can run.
    """
    return cores[1:] or cores


def keep_on_one_core(pid: int, which: int, cores: Sequence[int]) -> bool:
    """Have a process and its descendants, and what they will start, run on one core.

    Args:
        pid: the process.
        which: counts through the cores, so that several processes are spread over them.
        cores: to choose from, as of `our_cores`.

    Returns:
        Whether that could be done. Not where the system has no such call, nor for processes of others.
    """
    if not cores:
        return False
    core = {cores[which % len(cores)]}
    try:
        for tid in thread_ids(pid):
            with suppress(ProcessLookupError):  # it has just ended
                os.sched_setaffinity(tid, core)
    except OSError:
        return False
    return True


def runs_in_order(pid: int) -> bool:
    """Whether some thread of the process is a real-time one, as PX4's are where it may have them."""
    if not hasattr(os, "sched_getscheduler"):
        return False
    with suppress(OSError):
        return any(_is_real_time(tid) for tid in thread_ids(pid))
    return False


def core_in_order(pid: int) -> int | None:
    """The one core of a process whose threads are all real-time ones; None: there is no such core.

    Those that have the process's own name may be others: they serve PX4's shell.

    Raises:
        OSError: a thread ends meanwhile.
    """
    own_name = thread_name(f"{PROC}/{pid}")
    cores: set[int] = set()
    for tid in thread_ids(pid):
        if not _is_real_time(tid) and thread_name(f"{PROC}/{tid}") != own_name:
            return None
        cores |= os.sched_getaffinity(tid)
    return cores.pop() if len(cores) == 1 else None


def _is_real_time(tid: int) -> bool:
    return os.sched_getscheduler(tid) in {getattr(os, name) for name in _IN_ORDER}


def may_run_in_order() -> bool:
    """Whether what this process starts may have real-time threads of the priority that PX4 asks for: it is tried."""
    if not hasattr(os, "sched_setscheduler"):
        return False
    done: list[bool] = []

    def try_it() -> None:
        highest = os.sched_get_priority_max(os.SCHED_FIFO)
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(highest))
            done.append(True)

    thread = threading.Thread(target=try_it)
    thread.start()
    thread.join()
    return bool(done)
