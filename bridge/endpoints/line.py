"""A host at a terminal device: a pseudo-terminal of our own, or a serial line."""

from __future__ import annotations

import asyncio
import contextlib
import os
import pty
import tty
from typing import Final

from aps.links.kinds.serial import open_serial, speed_of
from aps.timeouts import LONGEST_RETRY_S
from bridge.endpoints.endpoint import Endpoint

READ_BYTES: Final = 1024
UNREAD_BYTES: Final = 1 << 16
"""More than the kernel keeps for a program that does not read."""


class _Line(Endpoint):
    """A file descriptor that is read when something is there."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._fd: int | None = None

    def _begin(self, fd: int) -> None:
        os.set_blocking(fd, False)
        self._fd = fd
        self.connections += 1
        if not self.is_held:
            self._go_on()

    def _end(self) -> None:
        if self._fd is not None:
            self._hold()
            os.close(self._fd)
            self._fd = None

    def write(self, data: bytes) -> None:
        """What the device takes at once."""
        self.unread_bytes += len(data) - self._written(data)

    def _written(self, data: bytes) -> int:
        """Write what the device takes; gives how much that was."""
        if self._fd is not None:
            with contextlib.suppress(OSError):  # it is full, or gone: the reader finds that, too
                return os.write(self._fd, data)
        return 0

    def _hold(self) -> None:
        if self._fd is not None:
            asyncio.get_running_loop().remove_reader(self._fd)

    def _go_on(self) -> None:
        if self._fd is not None:
            asyncio.get_running_loop().add_reader(self._fd, self._readable)

    def _readable(self) -> None:
        if self._fd is None:
            return
        try:
            data = os.read(self._fd, READ_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self.on_data(data, self)
        else:
            self._lost()

    def _lost(self) -> None:
        """The device has gone."""
        self._end()

    async def close(self) -> None:
        """Close the device."""
        self._end()


class PseudoTerminal(_Line):
    """A device that programs open like a serial port; its name is in `name` once it is open."""

    def __init__(self) -> None:
        super().__init__("pty")
        self._other: int | None = None
        """Its other side, kept open: programs may come and go."""

    async def open(self) -> None:
        """Make one."""
        fd, self._other = pty.openpty()
        tty.setraw(self._other)
        os.set_blocking(self._other, False)
        self.name = os.ttyname(self._other)
        self._begin(fd)

    def write(self, data: bytes) -> None:
        """All of it: of a device that is full, what nobody has read gives way, for whoever opens it late."""
        written = self._written(data)
        if written < len(data):
            self._forget_unread()
            written += self._written(data[written:])
        self.unread_bytes += len(data) - written

    def _forget_unread(self) -> None:
        if self._other is not None:
            with contextlib.suppress(OSError):  # nothing is left, or somebody reads it right now
                while unread := os.read(self._other, UNREAD_BYTES):
                    self.unread_bytes += len(unread)

    async def close(self) -> None:
        """Close both sides."""
        await super().close()
        if self._other is not None:
            os.close(self._other)
            self._other = None


class SerialPort(_Line):
    """A serial line, opened again when it vanishes, as USB adapters do.

    Raises:
        ValueError: the system has no such speed.
    """

    def __init__(self, name: str, device: str, baud: int) -> None:
        super().__init__(name)
        speed_of(baud)
        self._device, self._baud = device, baud
        self._again: asyncio.TimerHandle | None = None

    async def open(self) -> None:
        """Open it."""
        self._begin(open_serial(self._device, self._baud))

    def _lost(self) -> None:
        super()._lost()
        self.tell(f"{self.name} has gone: plug it in again")
        self._later()

    def _later(self) -> None:
        self._again = asyncio.get_running_loop().call_later(LONGEST_RETRY_S, self._reopen)

    def _reopen(self) -> None:
        try:
            line = open_serial(self._device, self._baud)
        except OSError:
            self._later()
        else:
            self.tell(f"{self.name} is back")
            self._begin(line)

    async def close(self) -> None:
        """Close it, and do not open it again."""
        if self._again is not None:
            self._again.cancel()
        await super().close()
