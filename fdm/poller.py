"""The cheapest wait for readable sockets that the system has."""

from __future__ import annotations

import os
import select
import time
from collections.abc import Sequence


class Poller:
    """Waits until a file descriptor can be read; one millisecond is its grain."""

    def __init__(self) -> None:
        self._poll: select.epoll | select.poll
        if hasattr(select, "epoll"):
            self._poll, self._readable, self._per_s = select.epoll(), select.EPOLLIN, 1000
        else:
            self._poll, self._readable, self._per_s = select.poll(), select.POLLIN, 1

    def register(self, fd: int) -> None:
        """Wait for `fd` too."""
        self._poll.register(fd, self._readable)

    def wait(self, timeout_ns: int, spin_ns: int = 0) -> Sequence[tuple[int, int]]:
        """What can be read, as pairs of file descriptor and event mask.

        Args:
            timeout_ns: longest wait, rounded up to a millisecond.
            spin_ns: look again and again for so long before going to sleep.
        """
        poll = self._poll.poll
        if timeout_ns <= 0:
            return poll(0)
        if spin_ns > 0:
            until_ns = time.monotonic_ns() + spin_ns
            while True:
                ready = poll(0)
                if ready or time.monotonic_ns() >= until_ns:
                    break
            if ready:
                return ready
        # select.epoll wants seconds, select.poll milliseconds.
        return poll(-(-timeout_ns // 1_000_000) / self._per_s)

    def close(self) -> None:
        """Give it back to the system."""
        if isinstance(self._poll, select.epoll):
            self._poll.close()


def core_count() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
