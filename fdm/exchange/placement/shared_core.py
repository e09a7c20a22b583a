"""Keeps this thread and the processes it waits for on one core, and gives them back. Without effect but on Linux."""

from __future__ import annotations

import contextlib
import ipaddress
import os
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path

import psutil

_PROCESSOR = 36
"""Place of the core in /proc/PID/stat, counted after the name (proc(5): field 39)."""


class SharedCore:
    """A core for the thread that makes this and for some processes, with all the threads that they have.

    What they start while they are held stays on the core until it is given back, but for other processes.

    Args:
        pids: the processes; one that has ended or is somebody else's is left as it is.
    """

    def __init__(self, pids: Sequence[int]) -> None:
        self._before: list[tuple[psutil.Process | None, int, set[int]]] = []
        own = threading.get_native_id()
        core = {_core_of(own)}
        self._hold(None, own, core)
        for pid in pids:
            with contextlib.suppress(psutil.Error):
                process = psutil.Process(pid)
                for thread in _threads(process):
                    self._hold(process, thread, core)

    def _hold(self, process: psutil.Process | None, thread: int, core: set[int]) -> None:
        with contextlib.suppress(OSError):  # it has just ended, or is not ours
            before = os.sched_getaffinity(thread)
            os.sched_setaffinity(thread, core)
            self._before.append((process, thread, before))

    def give_back(self) -> None:
        """Let all run where they might before, with what they have started since; from any thread, and again."""
        for process, thread, cores in self._before:
            threads = {thread}
            if process is not None:
                with contextlib.suppress(psutil.Error):
                    if not process.is_running():  # its number may be another's by now
                        continue
                    known = {other for _, other, _ in self._before}
                    threads |= set(_threads(process)) - known
            for each in threads:
                with contextlib.suppress(OSError):
                    os.sched_setaffinity(each, cores)
        self._before.clear()


def can_place() -> bool:
    """Whether the system lets us choose cores, and there is more than one to choose from."""
    return hasattr(os, "sched_setaffinity") and len(os.sched_getaffinity(0)) > 1


def process_at(address: tuple[str, int]) -> int | None:
    """The other process on this machine whose UDP socket has the loopback `address`; None if it cannot be found."""
    host, port = address
    if not ipaddress.ip_address(host).is_loopback:
        return None
    try:
        found = {
            connection.pid
            for connection in psutil.net_connections("udp4")
            if connection.laddr and connection.laddr.port == port and not connection.raddr
        }
    except (psutil.Error, OSError):
        return None
    return found.pop() if len(found) == 1 and os.getpid() not in found else None


def _core_of(thread: int) -> int:
    """The core that `thread` of this process is on: of those it may use, the system thought it the best."""
    allowed = os.sched_getaffinity(thread)
    with contextlib.suppress(OSError, ValueError, IndexError):
        stat = Path(f"/proc/self/task/{thread}/stat").read_text(encoding="ascii", errors="replace")
        core = int(stat.rpartition(")")[2].split()[_PROCESSOR])
        if core in allowed:
            return core
    return min(allowed)


def _threads(process: psutil.Process) -> Iterator[int]:
    return (thread.id for thread in process.threads())
