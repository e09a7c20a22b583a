"""How far each process of a fleet is, in memory that all of them share, and the wakes between them.

Three int64 per process: sim time of its slowest live UA (NEVER_NS: none is live), its longest step, and whether it
wants to be woken when the fleet's slowest moves. Each number has one writer, but for the last, which its process
sets and whoever wakes it clears. Before a process has started its slowest is 0, so that the others wait for it.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import tempfile

_ROWS = 3
_INT_BYTES = 8


class Board:
    """The view that one process has of the board (implements fdm.clock.fleet_clock.Peers).

    Args:
        fd: the shared memory, of `create_board`.
        index: which process this is, from 0.
        wake_fds: per process, the writing end of its wake pipe.
    """

    def __init__(self, fd: int, index: int, wake_fds: tuple[int, ...]) -> None:
        count = len(wake_fds)
        self._memory = mmap.mmap(fd, _ROWS * _INT_BYTES * count)
        self._view = memoryview(self._memory).cast("q")
        self._slowest_ns = self._view[:count]
        self._largest_step_ns = self._view[count : 2 * count]
        self._wanted = self._view[2 * count :]
        self._index = index
        self._wake_fds = wake_fds

    def slowest_ns(self) -> int:
        """Sim time of the slowest live UA of all processes; NEVER_NS if none is live."""
        return min(self._slowest_ns)

    def largest_step_ns(self) -> int:
        """The longest step of all processes."""
        return max(self._largest_step_ns)

    def slowest_of(self, index: int) -> int:
        """Sim time of the slowest live UA of process `index`."""
        return self._slowest_ns[index]

    def publish(self, slowest_ns: int, largest_step_ns: int) -> None:
        """Publish this process's numbers, and wake who waits for them if they matter."""
        before = (min(self._slowest_ns), self._largest_step_ns[self._index])
        self._slowest_ns[self._index] = slowest_ns
        self._largest_step_ns[self._index] = largest_step_ns
        if (min(self._slowest_ns), largest_step_ns) != before:
            self._wake_the_others()

    def ask_for_wake(self) -> None:
        """Have this process woken when the fleet's slowest moves."""
        self._wanted[self._index] = 1

    def close(self) -> None:
        """Let go of the memory."""
        for view in (self._slowest_ns, self._largest_step_ns, self._wanted, self._view):
            view.release()
        self._memory.close()

    def _wake_the_others(self) -> None:
        for index, wanted in enumerate(self._wanted):
            if wanted and index != self._index:
                self._wanted[index] = 0
                with contextlib.suppress(BlockingIOError, BrokenPipeError):  # full of wakes; or it has ended
                    os.write(self._wake_fds[index], b"\0")


def create_board(processes: int) -> int:
    """Shared memory for a board, all zero: a file descriptor that the caller closes."""
    size = _ROWS * _INT_BYTES * processes
    if hasattr(os, "memfd_create"):
        fd = os.memfd_create("fdm-board")
    else:
        with tempfile.TemporaryFile() as file:
            fd = os.dup(file.fileno())
    os.ftruncate(fd, size)
    return fd
