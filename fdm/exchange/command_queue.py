"""Commands from other threads for a loop that sleeps in a poller."""

from __future__ import annotations

import socket
from collections import deque
from collections.abc import Callable


class CommandQueue:
    """Holds commands until the loop obeys them, and wakes it through a file descriptor.

    Attributes:
        waiting: the commands, oldest first.
    """

    __slots__ = ("_closed", "_receiver", "_sender", "waiting")

    def __init__(self) -> None:
        self.waiting: deque[Callable[[], None]] = deque()
        self._closed = False
        self._receiver, self._sender = socket.socketpair()
        self._receiver.setblocking(False)
        self._sender.setblocking(False)

    def fileno(self) -> int:
        """The descriptor that can be read once the loop is to wake."""
        return self._receiver.fileno()

    def put(self, command: Callable[[], None]) -> None:
        """Have the loop run `command` soon; from any thread, and without effect after `close`."""
        self.waiting.append(command)
        self.wake()

    def wake(self) -> None:
        """Wake the loop; also from a signal handler."""
        try:
            self._sender.send(b"\0")
        except BlockingIOError:
            return  # it is full of wakes already
        except OSError:
            if not self._closed:
                raise

    def drain(self) -> None:
        """Take note of the wakes that came."""
        try:
            self._receiver.recv(4096)
        except BlockingIOError:
            return

    def obey(self) -> None:
        """Run the commands that wait; in the loop's thread."""
        while self.waiting:
            self.waiting.popleft()()

    def close(self) -> None:
        """Close both ends."""
        self._closed = True
        self._receiver.close()
        self._sender.close()
