"""Links over TCP: a server for many clients, and a connection that is made again when it is lost."""

from __future__ import annotations

import asyncio
import logging
import socket
import weakref
from typing import Final, cast

from aps.links.address import LinkAddress
from aps.links.link import Link, LinkOwner
from aps.links.outbox import Outbox
from aps.timeouts import CONNECT_TIMEOUT_S, FIRST_RETRY_S, LONGEST_RETRY_S

READ_BYTES: Final = 4 * 1024
"""Read from a client at once: what comes faster is worked off in turns with the others."""
CONNECTOR_READ_BYTES: Final = 64 * 1024
RECEIVE_BUFFER_BYTES: Final = 32 * 1024
"""Asked of the kernel, which grants twice as much."""
BACKLOG: Final = 16
"""Connections accepted in one turn of the event loop."""

_log = logging.getLogger(__name__)


class TcpLink(Link, asyncio.BufferedProtocol):
    """One TCP connection."""

    outbox: Outbox

    def __init__(self, owner: LinkOwner, address: LinkAddress, limit_bytes: int, read_bytes: int) -> None:
        super().__init__(str(address), Outbox(limit_bytes), address.opening)
        self.ended = asyncio.Event()
        self.why: Exception | None = None
        """What the connection ended of, if it was an error."""
        self._owner = owner
        self._buffer = memoryview(bytearray(read_bytes))
        self._transport: asyncio.Transport | None = None
        self._accepted = False

    def abort(self) -> None:
        """Close at once, without waiting for the peer to read."""
        if self._transport is not None:
            self._transport.abort()

    def _pause_reading(self) -> None:
        if self._transport is not None:
            self._transport.pause_reading()

    def _resume_reading(self) -> None:
        if self._transport is not None:
            self._transport.resume_reading()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """asyncio: the connection is there."""
        transport = cast(asyncio.Transport, transport)  # uvloop's is none by its class
        self._transport = transport
        if self.name.startswith("tcp-server"):
            address = transport.get_extra_info("peername") or ("?", 0)
            self.name = f"{address[0]}:{address[1]}"
        self.outbox.open(transport)
        connection = transport.get_extra_info("socket")
        if connection is not None and len(self._buffer) < RECEIVE_BUFFER_BYTES:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        self._accepted = self._owner.link_opened(self)
        if not self._accepted:
            transport.abort()

    def get_buffer(self, sizehint: int) -> memoryview:  # noqa: ARG002 (asyncio hints at nothing)
        """asyncio: where to read to."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """asyncio: bytes came."""
        if self._accepted:
            self._owner.link_data(self, bytes(self._buffer[:nbytes]))

    def pause_writing(self) -> None:
        """asyncio: the write buffer is full."""
        self.outbox.pause()

    def resume_writing(self) -> None:
        """asyncio: the write buffer has room again."""
        self.outbox.resume()

    def connection_lost(self, exc: Exception | None) -> None:
        """asyncio: the connection is gone."""
        self._transport, self.why = None, exc
        self.outbox.close()
        self.ended.set()
        if self._accepted:
            self._accepted = False
            self._owner.link_closed(self, exc)


class TcpServer:
    """Listens for clients; each is a link."""

    def __init__(self, address: LinkAddress, owner: LinkOwner, limit_bytes: int) -> None:
        self.address = address
        self._owner, self._limit_bytes = owner, limit_bytes
        self._server: asyncio.Server | None = None
        self._links: weakref.WeakSet[TcpLink] = weakref.WeakSet()

    @property
    def port(self) -> int:
        """The port that it listens on (useful when 0 was asked for)."""
        if self._server is None:
            raise RuntimeError("the server does not listen yet")
        port: int = self._server.sockets[0].getsockname()[1]
        return port

    async def start(self) -> None:
        """Begin to listen.

        Raises:
            OSError: as from ``bind``; EADDRINUSE when the port is taken.
        """
        try:
            self._server = await asyncio.get_running_loop().create_server(
                self._link,
                self.address.host,
                self.address.port,
                backlog=BACKLOG,
            )
        except socket.gaierror as error:  # which does not say what
            raise OSError(error.errno, f"cannot listen on {self.address}: {error.strerror}") from error

    def _link(self) -> TcpLink:
        link = TcpLink(self._owner, self.address, self._limit_bytes, READ_BYTES)
        self._links.add(link)
        return link

    async def run(self) -> None:
        """Nothing to be done: asyncio accepts."""

    def close(self) -> None:
        """Stop listening, and drop all clients."""
        if self._server is not None:
            self._server.close()
        for link in list(self._links):
            link.abort()


class TcpConnector:
    """Keeps one connection up; each connection is a new link."""

    def __init__(self, address: LinkAddress, owner: LinkOwner, limit_bytes: int) -> None:
        self.address = address
        self.connections = 0
        """How often a connection was made."""
        self._owner, self._limit_bytes = owner, limit_bytes

    async def start(self) -> None:
        """Nothing can be refused: the peer may come later."""

    def close(self) -> None:
        """Nothing is left when ``run`` has ended."""

    async def run(self) -> None:
        """Connect and reconnect until cancelled; the connection is closed on the way out."""
        retry_s, told = FIRST_RETRY_S, False
        while True:
            link = await self._connected(tell=not told)
            told = link is None
            if link is not None:
                await self._until_lost(link)
                retry_s = FIRST_RETRY_S if link.traffic.frames else retry_s
            await asyncio.sleep(retry_s)
            retry_s = min(retry_s * 2.0, LONGEST_RETRY_S)

    async def _connected(self, *, tell: bool) -> TcpLink | None:
        def make() -> TcpLink:
            return TcpLink(self._owner, self.address, self._limit_bytes, CONNECTOR_READ_BYTES)

        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(CONNECT_TIMEOUT_S):
                _, link = await loop.create_connection(make, self.address.host, self.address.port)
        except OSError as error:
            if tell:
                _log.warning("nobody at %s yet (%s): trying again", self.address, error)
            return None
        self.connections += 1
        _log.info("connected to %s", self.address)
        return link

    async def _until_lost(self, link: TcpLink) -> None:
        try:
            await link.ended.wait()
        finally:
            link.abort()
        _log.warning(
            "connection to %s lost%s", self.address, f" ({link.why})" if link.why is not None else ""
        )
