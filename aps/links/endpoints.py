"""The TCP server for MAVLink clients: ground stations, MAVSDK programs, scripts; many at once.

Each client has its own framer and its own bounded queue, so that a slow, dead or babbling one costs the
others nothing.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Callable
from typing import Final

from aps.links.outbox import Outbox
from aps.wire.framer import Framer

__all__ = ["Client", "ClientServer"]

DEFAULT_MAX_CLIENTS: Final = 64
RECEIVE_BUFFER_BYTES: Final = 32 * 1024
"""Asked of the kernel, which grants twice as much: what a client sends at once is worked off in so large pieces."""

_log = logging.getLogger(__name__)


class Client(asyncio.Protocol):
    """One connected client."""

    def __init__(self, server: ClientServer) -> None:
        self.link = 0
        """Link id in the routing table, set when the connection is made."""
        self.peer = ""
        self.framer = Framer()
        self.outbox = Outbox(server.limit_bytes)
        self._server = server
        self._transport: asyncio.Transport | None = None

    def pause_reading(self) -> None:
        """Leave further bytes in the kernel, so that the peer has to wait."""
        if self._transport is not None:
            self._transport.pause_reading()

    def resume_reading(self) -> None:
        """Read again."""
        if self._transport is not None:
            self._transport.resume_reading()

    def abort(self) -> None:
        """Close at once, without waiting for the peer to read."""
        if self._transport is not None:
            self._transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """asyncio: the connection is there."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        address = transport.get_extra_info("peername") or ("?", 0)
        self.peer = f"{address[0]}:{address[1]}"
        self.outbox.open(transport)
        connection = transport.get_extra_info("socket")
        if connection is not None:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        self._server.opened(self)

    def data_received(self, data: bytes) -> None:
        """asyncio: bytes came."""
        if self.link:
            self._server.on_data(self, data)

    def pause_writing(self) -> None:
        """asyncio: the write buffer is full."""
        self.outbox.pause()

    def resume_writing(self) -> None:
        """asyncio: the write buffer has room again."""
        self.outbox.resume()

    def connection_lost(self, exc: Exception | None) -> None:
        """asyncio: the connection is gone."""
        self._transport = None
        self.outbox.close()
        self._server.closed(self, exc)


class ClientServer:
    """Listens for clients and numbers them. Callbacks run in the event loop.

    Args:
        on_open: a client is there, with its ``link`` id.
        on_data: bytes from a client.
        on_close: a client is gone.
        first_link: link id of the first client; each further one gets the next (ids are not used twice).
        limit_bytes: bound of each client's queue.
        max_clients: further connections are closed at once and counted.
    """

    def __init__(
        self,
        on_open: Callable[[Client], None],
        on_data: Callable[[Client, bytes], None],
        on_close: Callable[[Client], None],
        *,
        first_link: int,
        limit_bytes: int,
        max_clients: int = DEFAULT_MAX_CLIENTS,
    ) -> None:
        self.on_data = on_data
        self.limit_bytes = limit_bytes
        self.max_clients = max_clients
        self.clients: dict[int, Client] = {}
        self.accepted = 0
        self.turned_away = 0
        self.leaving = 0
        """Clients that are gone but not yet forgotten: they count towards ``max_clients``."""
        self.listeners = False
        """Clients from now on only listen: their link ids are -1, -2, ..., which no other link has."""
        self._on_open, self._on_close = on_open, on_close
        self._next_link = first_link
        self._next_listener = -1
        self._server: asyncio.Server | None = None

    @property
    def port(self) -> int:
        """The port that it listens on (useful when 0 was asked for)."""
        if self._server is None:
            raise RuntimeError("the server does not listen yet")
        port: int = self._server.sockets[0].getsockname()[1]
        return port

    async def listen(self, host: str, port: int) -> None:
        """Begin to listen.

        Raises:
            OSError: as from ``bind``; EADDRINUSE when the port is taken.
        """
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(lambda: Client(self), host, port)

    def close(self) -> None:
        """Stop listening and drop all clients."""
        if self._server is not None:
            self._server.close()
        for client in list(self.clients.values()):
            client.abort()

    def opened(self, client: Client) -> None:
        """Called by a client's protocol."""
        if len(self.clients) + self.leaving >= self.max_clients:
            self.turned_away += 1
            _log.warning("client %s turned away: %d are connected already", client.peer, self.max_clients)
            client.abort()
            return
        client.link = self._number()
        self.accepted += 1
        self.clients[client.link] = client
        _log.info("client %s connected", client.peer)
        self._on_open(client)

    def _number(self) -> int:
        if self.listeners:
            self._next_listener -= 1
            return self._next_listener + 1
        self._next_link += 1
        return self._next_link - 1

    def reserve(self, link: int) -> None:
        """Give no client this link id or a lower one from now on."""
        self._next_link = max(self._next_link, link + 1)

    def closed(self, client: Client, error: Exception | None) -> None:
        """Called by a client's protocol."""
        if self.clients.pop(client.link, None) is not None:
            _log.info("client %s left%s", client.peer, f" ({error})" if error is not None else "")
            self._on_close(client)
