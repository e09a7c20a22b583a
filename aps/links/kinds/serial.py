"""Links over serial lines (POSIX): opened again when the device vanishes, as USB adapters do."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import termios
import time
import tty
from collections.abc import Callable
from typing import Final

from aps.links.address import LinkAddress
from aps.links.link import Link, LinkOwner, Role
from aps.links.outbox import LEAST_QUEUE_BYTES, FrameQueue
from aps.timeouts import FIRST_RETRY_S, LONGEST_RETRY_S
from aps.wire.framer import MAX_FRAME_BYTES

READ_BYTES: Final = 4 * 1024
BITS_PER_BYTE: Final = 10
QUEUE_S: Final = 10.0
"""So much of what the line carries may wait for it: a list of parameters, say."""
BEHIND_S: Final = 10.0
"""A line that has been behind for so long cannot keep up ..."""
NEWEST_S: Final = 1.0
"""... and until nothing waits any more, only so much of the newest is kept: else all that comes is late for good."""
_SPEED_AT: Final = (4, 5)
"""Where ``termios.tcgetattr`` has the input and output speed."""

_log = logging.getLogger(__name__)


def speed_of(baud: int) -> int:
    """The system's constant for a speed.

    Raises:
        ValueError: it has none.
    """
    speed: int | None = getattr(termios, f"B{baud}", None)
    if speed is None:
        raise ValueError(f"a serial line cannot run at {baud} baud: the system has no such speed")
    return speed


def open_serial(device: str, baud: int) -> int:
    """Open a serial line, raw and at a speed; returns its file descriptor.

    Raises:
        OSError: it cannot be opened, or is no serial line.
        ValueError: the system has no such speed.
    """
    speed = speed_of(baud)
    line = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        tty.setraw(line, termios.TCSANOW)
        settings = termios.tcgetattr(line)
        for at in _SPEED_AT:
            settings[at] = speed
        settings[2] |= termios.CLOCAL | termios.CREAD
        termios.tcsetattr(line, termios.TCSANOW, settings)
    except termios.error as error:
        os.close(line)
        raise OSError(f"{device} is no serial line: {error}") from error
    return line


class SerialOutbox(FrameQueue):
    """Frames wait here while the line is busy.

    Args:
        limit_bytes: may wait.
        line: its file descriptor.
        bytes_per_s: that the line carries.
        clock_s: wall time.
    """

    def __init__(
        self, limit_bytes: int, line: int, bytes_per_s: int, clock_s: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__(max(min(limit_bytes, round(QUEUE_S * bytes_per_s)), LEAST_QUEUE_BYTES))
        self._line, self._clock_s = line, clock_s
        self._write_bytes = max(bytes_per_s // 10, MAX_FRAME_BYTES)
        """Handed to the system at once: what it does not take of it cannot give way any more."""
        self._newest_bytes = round(NEWEST_S * bytes_per_s)
        self._behind_since_s: float | None = None
        self._cannot_keep_up = False
        self._unsent = b""
        self._waits = False
        self.admit()

    def flush(self) -> None:
        """Write as much as the line takes; the rest when it has room."""
        self._look_how_far_behind()
        if self._waits or not self._open:
            return
        loop = asyncio.get_running_loop()
        data = self._unsent or self.take(self._write_bytes)
        while data:
            try:
                data = data[os.write(self._line, data) :]
            except BlockingIOError:
                self._unsent, self._waits = data, True
                loop.add_writer(self._line, self._writable)
                return
            except OSError as error:
                _log.debug("serial line: %s", error)  # the reader finds the same, and closes
                return
            data = data or self.take(self._write_bytes)
        self._unsent = b""

    def _look_how_far_behind(self) -> None:
        if self._waiting_bytes <= self._newest_bytes:
            self._behind_since_s = None
            self._cannot_keep_up = self._cannot_keep_up and bool(self.waiting)
            return
        now_s = self._clock_s()
        if self._behind_since_s is None:
            self._behind_since_s = now_s
        if not self._cannot_keep_up and now_s - self._behind_since_s >= BEHIND_S:
            self._cannot_keep_up = True
            self.counters.stalls += 1
        if self._cannot_keep_up:
            self._drop_oldest(self._newest_bytes)

    def _writable(self) -> None:
        asyncio.get_running_loop().remove_writer(self._line)
        self._waits = False
        self.flush()

    def close(self) -> None:
        """The line is gone: what waits is counted as dropped."""
        if self._waits:
            asyncio.get_running_loop().remove_writer(self._line)
        self._waits, self._unsent = False, b""
        super().close()


class SerialLink(Link):
    """One serial line while it is open."""

    def __init__(self, owner: LinkOwner, address: LinkAddress, limit_bytes: int, line: int) -> None:
        outbox = SerialOutbox(limit_bytes, line, address.baud // BITS_PER_BYTE)
        super().__init__(str(address), outbox, address.opening, connectionless=True)
        self.ended = asyncio.Event()
        self._owner, self._line = owner, line

    def _resume_reading(self) -> None:
        if not self.ended.is_set():
            asyncio.get_running_loop().add_reader(self._line, self._readable)

    def _pause_reading(self) -> None:
        if not self.ended.is_set():
            asyncio.get_running_loop().remove_reader(self._line)

    def start(self) -> None:
        """Read from now on."""
        self._resume_reading()

    def abort(self) -> None:
        """Stop reading, and have the line closed."""
        self._pause_reading()
        self.ended.set()

    def _readable(self) -> None:
        try:
            data = os.read(self._line, READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            _log.debug("%s: %s", self.name, error)
            data = b""
        if data:
            self._owner.link_data(self, data)
        else:
            self.abort()


class SerialConnector:
    """Keeps one serial line open; each time that it is opened is a new link.

    An autopilot's has the counts of the one before: what was lost while the device was away is missing by its numbers.
    """

    def __init__(self, address: LinkAddress, owner: LinkOwner, limit_bytes: int) -> None:
        self.address = address
        self.connections = 0
        """How often it was opened."""
        self._owner, self._limit_bytes = owner, limit_bytes
        self._before: SerialLink | None = None

    async def start(self) -> None:
        """See that there can be such a line; the device itself may come later.

        Raises:
            ValueError: the system has no such speed.
        """
        speed_of(self.address.baud)

    def close(self) -> None:
        """Nothing is left when ``run`` has ended."""

    async def run(self) -> None:
        """Open, and open again, until cancelled."""
        retry_s, told = FIRST_RETRY_S, False
        while True:
            try:
                line = open_serial(self.address.device, self.address.baud)
            except OSError as error:
                if not told:
                    _log.warning("no %s yet (%s): trying again", self.address, error)
                told = True
            else:
                told, retry_s = False, FIRST_RETRY_S
                await self._serve(line)
            await asyncio.sleep(retry_s)
            retry_s = min(retry_s * 2.0, LONGEST_RETRY_S)

    async def _serve(self, line: int) -> None:
        link = SerialLink(self._owner, self.address, self._limit_bytes, line)
        if link.role is Role.AUTOPILOT:
            if self._before is not None:
                link.traffic, link.framer = self._before.traffic, self._before.framer
            self._before = link
        try:
            if self._owner.link_opened(link):
                self.connections += 1
                _log.info("opened %s", self.address)
                link.start()
                await link.ended.wait()
                _log.warning("%s lost", self.address)
        finally:
            link.abort()
            link.outbox.close()
            self._owner.link_closed(link, None)
            with contextlib.suppress(OSError):
                os.close(line)
