"""What is at the serial side of modems: a further serial port of an autopilot, or ground stations outside the run."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from functools import partial
from math import inf
from typing import Final

from aps.links.kinds.held import MAX_WRITE_BYTES, HeldLink
from bridge.endpoints.endpoint import Endpoint

HOLD_BYTES, GO_ON_BYTES = 512, 256
"""A ground station is not read while so much of it waits for the line; it is again from here on."""
WAITING_MAX_BYTES: Final = 16_384
"""What may wait of one that cannot wait."""
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


class GroundPort:
    """Ground stations outside the run (`Device`): all see the same bytes, and all may send.

    Args:
        endpoints: where they are.
        baud: of the line; 0: there is none.
        period_ns: between two exchanges; at each no more is taken than the line carries in it.
    """

    def __init__(self, endpoints: Sequence[Endpoint], baud: int, period_ns: int) -> None:
        self._endpoints = tuple(endpoints)
        self._most_bytes = -(-baud * period_ns // (BITS_PER_BYTE * 10**9)) or NO_LINE_BYTES
        self._waiting = bytearray()
        self.overrun_bytes = 0
        """Of ground stations that cannot wait, and sent more than the line carries."""

    async def open(self) -> None:
        """Let them come.

        Raises:
            OSError: a port is in use, or there is no such device.
        """
        for endpoint in self._endpoints:
            endpoint.on_data = partial(self._came, endpoint)
            await endpoint.open()

    @property
    def names(self) -> tuple[str, ...]:
        """Where they are, with the ports and devices that were found."""
        return tuple(endpoint.name for endpoint in self._endpoints)

    @property
    def unread_bytes(self) -> int:
        """That nobody took."""
        return sum(endpoint.unread_bytes for endpoint in self._endpoints)

    def read(self) -> bytes:
        """What they have sent, as far as the line carries it."""
        data = bytes(self._waiting[: self._most_bytes])
        del self._waiting[: self._most_bytes]
        if len(self._waiting) <= GO_ON_BYTES:
            for endpoint in self._endpoints:
                endpoint.go_on()
        return data

    def write(self, pieces: Sequence[bytes]) -> None:
        """To all."""
        for endpoint in self._endpoints:
            endpoint.write_all(pieces)

    def _came(self, endpoint: Endpoint, data: bytes) -> None:
        if not endpoint.can_wait and len(self._waiting) > WAITING_MAX_BYTES:
            self.overrun_bytes += len(data)
            return
        self._waiting += data
        if len(self._waiting) > HOLD_BYTES:
            for each in self._endpoints:
                each.hold()

    async def close(self) -> None:
        """Send them away."""
        for endpoint in self._endpoints:
            await endpoint.close()
