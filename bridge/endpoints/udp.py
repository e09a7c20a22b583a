"""A host that sends and takes UDP datagrams."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import Any, cast

from bridge.endpoints.endpoint import Endpoint


class _Udp(Endpoint, asyncio.DatagramProtocol):
    """A socket."""

    can_wait = False

    def __init__(self, name: str, host: str, port: int) -> None:
        super().__init__(name)
        self._place = (host, port)
        self._transport: asyncio.DatagramTransport | None = None
        self._latest_bytes = 0
        """Written last, at once; what is refused is one of these, and each that the kernel then takes no more."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """asyncio: the socket is open."""
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: Any) -> None:  # noqa: ARG002 (of one peer)
        """asyncio: a datagram came."""
        self.on_data(data, self)

    def error_received(self, exc: Exception) -> None:  # noqa: ARG002 (that it was refused is enough)
        """asyncio: nobody listens there yet; the next datagram may arrive."""
        self.unread_bytes += self._latest_bytes
        self._latest_bytes = 0

    def write_all(self, pieces: Sequence[bytes]) -> None:
        """A datagram each."""
        if pieces:  # of none nothing is refused
            self._latest_bytes = 0
        for piece in pieces:
            self.write(piece)

    def _hold(self) -> None:
        """A datagram that is not read is lost all the same."""

    def _go_on(self) -> None:
        """It was read all along."""

    async def close(self) -> None:
        """Close the socket."""
        if self._transport is not None:
            self._transport.abort()


class UdpTarget(_Udp):
    """Sends to a port that is known, and takes what comes back from there."""

    async def open(self) -> None:
        """Open the socket."""
        loop = asyncio.get_running_loop()
        await loop.create_datagram_endpoint(lambda: self, remote_addr=self._place)
        self.connections = 1

    def write(self, data: bytes) -> None:
        """In a datagram."""
        if self._transport is not None:
            self._latest_bytes += len(data)
            self._transport.sendto(data)


class UdpPort(_Udp):
    """Waits for whoever sends, and answers the last that did."""

    def __init__(self, name: str, host: str, port: int) -> None:
        super().__init__(name, host, port)
        self._peer: Any = None

    async def open(self) -> None:
        """Open the socket."""
        loop = asyncio.get_running_loop()
        transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=self._place)
        port = transport.get_extra_info("sockname")[1]
        self.name = f"{self.name.rpartition(':')[0]}:{port}"

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """asyncio: a datagram came."""
        if addr != self._peer:
            self._peer = addr
            self.connections += 1
        self.on_data(data, self)

    def write(self, data: bytes) -> None:
        """In a datagram, once somebody is known."""
        if self._transport is None or self._peer is None:
            self.unread_bytes += len(data)
        else:
            self._transport.sendto(data, self._peer)
