"""The connection to an autopilot in this process: held by its nature, and without a socket."""

from __future__ import annotations

from typing import Protocol

from aps.links.address import LinkAddress
from aps.links.kinds.held import RECEIVE_BUFFER_BYTES, HeldLink


class CalledClient(Protocol):
    """An autopilot's side of the connection."""

    def connect(self) -> None:
        """A client is there."""

    def disconnect(self) -> None:
        """It is gone."""

    def read(self) -> bytes:
        """All that the autopilot has said since the last call."""

    def write(self, data: bytes) -> None:
        """Say something to the autopilot, from its next frame on."""


class CalledLink(HeldLink):
    """One connection, as `HeldLink` to who reads and writes it.

    Args:
        autopilot: who is called.
        address: what it would listen on, for logs.
        limit_bytes: bound of the queue towards the autopilot.
    """

    def __init__(self, autopilot: CalledClient, address: LinkAddress, limit_bytes: int) -> None:
        super().__init__(address, limit_bytes)
        self._autopilot = autopilot
        self._is_up = False
        self.receive_buffer_bytes = 2 * RECEIVE_BUFFER_BYTES

    @property
    def up(self) -> bool:
        """Whether there is a connection."""
        return self._is_up

    async def connect(self) -> None:
        """Connect, unless there is a connection."""
        self.connect_now()

    def connect_now(self) -> bool:
        """As `connect`."""
        if not self._is_up:
            self._is_up = True
            self.connections += 1
            self._autopilot.connect()
            self.outbox.admit()
        return True

    def read(self) -> bytes:
        """All that the autopilot has written."""
        return self._autopilot.read()

    def write(self, data: bytes) -> bool:
        """Write ``data``; it takes everything."""
        if data:
            self._autopilot.write(data)
        return True

    def close(self) -> None:
        """Drop the connection, if there is one."""
        if self._is_up:
            self._is_up = False
            self._autopilot.disconnect()
        self.outbox.close()
