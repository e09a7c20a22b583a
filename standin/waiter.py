"""The wait for sensor frames, of all autopilots of a process, and the news that a client has sent something."""

from __future__ import annotations

import select
import socket
from collections.abc import Callable
from typing import Generic, TypeVar

TELLS_ARRIVALS = hasattr(select, "epoll")
"""Whether the system reports clients too. Elsewhere than on Linux one has to look, at every frame."""

T = TypeVar("T")


class Waiter(Generic[T]):
    """Waits for sensor frames; a ``T`` is who gets them.

    A client is reported once per arrival: what came stays in its socket until the next frame, and must not wake
    the process again and again.
    """

    def __init__(self) -> None:
        self._frames: dict[int, T] = {}
        self._arrivals: dict[int, Callable[[], object]] = {}
        if TELLS_ARRIVALS:
            self._epoll = select.epoll()
        else:
            self._poll = select.poll()

    def add_physics(self, sock: socket.socket, whose: T) -> None:
        """Wait for frames on ``sock``."""
        self._frames[sock.fileno()] = whose
        if TELLS_ARRIVALS:
            self._epoll.register(sock, select.EPOLLIN)
        else:
            self._poll.register(sock, select.POLLIN)

    def add_client(self, sock: socket.socket, on_arrival: Callable[[], object]) -> None:
        """Call ``on_arrival`` when something has arrived on ``sock``, before the frames that are there by then."""
        if TELLS_ARRIVALS:
            self._arrivals[sock.fileno()] = on_arrival
            self._epoll.register(sock, select.EPOLLIN | select.EPOLLET)

    def remove_client(self, sock: socket.socket) -> None:
        """``sock`` is about to be closed."""
        if TELLS_ARRIVALS:
            del self._arrivals[sock.fileno()]
            self._epoll.unregister(sock)

    def wait(self, timeout_s: float) -> list[T]:
        """Wait for ``timeout_s`` at most; return those whose frames are there."""
        ready = self._epoll.poll(timeout_s) if TELLS_ARRIVALS else self._poll.poll(1000.0 * timeout_s)
        frames, due = self._frames, []
        for fd, _ in ready:
            if fd in frames:
                due.append(frames[fd])
            else:
                self._arrivals[fd]()
        return due

    def close(self) -> None:
        """Give it back to the system."""
        if TELLS_ARRIVALS:
            self._epoll.close()
