"""What is at the serial side of modems: a further serial port of an autopilot, or ground stations outside the run."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Sequence
from math import inf
from typing import Final

from aps.links.kinds.held import MAX_WRITE_BYTES, HeldLink
from bridge.endpoints.endpoint import Endpoint
from bridge.modem.units import LONGEST_FRAME_BYTES, WholeFrames, unit_bytes

WAITING_MAX_BYTES: Final = 16_384
"""What may wait of a ground station that cannot wait."""
NO_LINE_BYTES: Final = 8_192
"""Taken per exchange where there is no serial line."""
BITS_PER_BYTE: Final = 10
log = logging.getLogger("host")


class AutopilotPort:
    """A further serial port of an autopilot (`Device`).

    ArduPilot's SITL opens it when it has booted, and anew when it has rebooted. What is tried while it is held has the
    same outcome each time.

    Args:
        link: to it.
        on_wall_time: called with the reason when a run may not repeat.

    Attributes:
        unread_bytes: that the autopilot did not read in time: beyond what the kernel holds few wait.
    """

    def __init__(self, link: HeldLink, on_wall_time: Callable[[str], object]) -> None:
        self.link, self._on_wall_time = link, on_wall_time
        self.unread_bytes = 0

    def read(self) -> bytes:
        """All that the autopilot has written."""
        self.link.connect_now()
        return self.link.read()

    def write(self, pieces: Sequence[bytes]) -> None:
        """All that has come out of the modem; nobody gets it while the port is not open."""
        unsent_bytes, taken = self.link.unsent_bytes, []
        room_bytes = MAX_WRITE_BYTES - unsent_bytes if unsent_bytes else inf
        for piece in pieces:
            if len(piece) <= room_bytes:
                room_bytes -= len(piece)
                taken.append(piece)
            else:
                self.unread_bytes += len(piece)
        if not self.link.write(b"".join(taken)):
            self._on_wall_time("its autopilot does not read a serial port with a modem")

    def close(self) -> None:
        """Close the connection."""
        self.link.close()


class _Station:
    """A ground station, or several behind one endpoint, and what of it waits for the line."""

    def __init__(self, endpoint: Endpoint, hold_bytes: int, *, is_alone: bool) -> None:
        self.endpoint, self._hold_bytes, self._is_alone = endpoint, hold_bytes, is_alone
        self.overrun_bytes = 0
        self._waiting = bytearray()
        self._frames = WholeFrames()

    def came(self, data: bytes, host: object) -> None:
        """It sends; one that can wait is not read while as much waits as the line carries in two exchanges."""
        data = self._frames.came(data, host, is_alone=self._is_alone and self.endpoint.hosts < 2)
        if not self.endpoint.can_wait and len(self._waiting) > WAITING_MAX_BYTES:
            self.overrun_bytes += len(data)
            return
        self._waiting += data
        if len(self._waiting) > self._hold_bytes:
            self.endpoint.hold()

    def take(self) -> bytes:
        """A MAVLink frame, or bytes that are none; empty: nothing waits."""
        length = unit_bytes(bytes(self._waiting[:LONGEST_FRAME_BYTES]))
        data = bytes(self._waiting[:length])
        del self._waiting[:length]
        return data

    def go_on(self) -> None:
        """Read it again, if no more waits than the line carries until the next exchange."""
        if len(self._waiting) <= self._hold_bytes // 2:
            self.endpoint.go_on()


class GroundPort:
    """Ground stations outside the run (`Device`): all see the same bytes, and all may send, frame by frame in turn.

    Args:
        endpoints: where they are.
        baud: of the line; 0: there is none.
        period_ns: between two exchanges; at each no more is taken than the line carries in it.
    """

    def __init__(self, endpoints: Sequence[Endpoint], baud: int, period_ns: int) -> None:
        self._endpoints = tuple(endpoints)
        self._most_bytes = -(-baud * period_ns // (BITS_PER_BYTE * 10**9)) or NO_LINE_BYTES
        hold_bytes, is_alone = 2 * self._most_bytes, len(endpoints) < 2
        self._stations = deque(_Station(endpoint, hold_bytes, is_alone=is_alone) for endpoint in endpoints)
        """The next in turn first."""
        self._begun = b""
        """The rest of what was taken, and is longer than what the line carried."""

    async def open(self) -> None:
        """Let them come.

        Raises:
            OSError: a port is in use, or there is no such device.
        """
        for station in tuple(self._stations):
            station.endpoint.on_data = station.came
            await station.endpoint.open()

    @property
    def names(self) -> tuple[str, ...]:
        """Where they are, with the ports and devices that were found."""
        return tuple(endpoint.name for endpoint in self._endpoints)

    @property
    def unread_bytes(self) -> int:
        """That nobody took."""
        return sum(endpoint.unread_bytes for endpoint in self._endpoints)

    @property
    def overrun_bytes(self) -> int:
        """Of ground stations that cannot wait, and sent more than the line carries."""
        return sum(station.overrun_bytes for station in self._stations)

    def read(self) -> bytes:
        """What they have sent, as far as the line carries it."""
        data = bytearray(self._begun)
        while len(data) < self._most_bytes and (piece := self._next()):
            data += piece
        self._begun = bytes(data[self._most_bytes :])
        for station in self._stations:
            station.go_on()
        return bytes(data[: self._most_bytes])

    def _next(self) -> bytes:
        """What comes next of whoever is in turn and has something; empty: nobody has."""
        for _ in range(len(self._stations)):
            data = self._stations[0].take()
            self._stations.rotate(-1)
            if data:
                return data
        return b""

    def write(self, pieces: Sequence[bytes]) -> None:
        """To all."""
        for endpoint in self._endpoints:
            endpoint.write_all(pieces)

    async def close(self) -> None:
        """Send them away."""
        for endpoint in self._endpoints:
            await endpoint.close()
