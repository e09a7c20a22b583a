"""The cheapest wait for readable sockets that the system has."""

from __future__ import annotations

import select
import time
from collections.abc import Sequence

WAIT_MAX_NS = 60_000_000_000
"""Longer waits end early: the system counts milliseconds in an int, which 25 days overflow."""

EAGER_NS = 200_000
"""To fall asleep and be woken takes tens of microseconds, on virtual machines."""


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

    def unregister(self, fd: int) -> None:
        """Wait for `fd` no longer; it is still open."""
        self._poll.unregister(fd)

    def wait(self, timeout_ns: int, *, eager: bool = False) -> Sequence[tuple[int, int]]:
        """What can be read after at most `timeout_ns`, rounded up to a millisecond: pairs of fd and event mask.

        No wait is longer than WAIT_MAX_NS. An `eager` one looks for EAGER_NS before it sleeps.
        """
        if eager:
            until_ns = time.monotonic_ns() + min(EAGER_NS, timeout_ns)
            while not (ready := self._poll.poll(0)):
                if time.monotonic_ns() >= until_ns:
                    break
            else:
                return ready
        timeout_ms = 0 if timeout_ns <= 0 else -(-min(timeout_ns, WAIT_MAX_NS) // 1_000_000)
        return self._poll.poll(
            timeout_ms / self._per_s
        )  # select.epoll wants seconds, select.poll milliseconds

    def close(self) -> None:
        """Give it back to the system."""
        if isinstance(self._poll, select.epoll):
            self._poll.close()
