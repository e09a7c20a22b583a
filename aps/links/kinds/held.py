"""The TCP connection to an autopilot that is held: read and written only when its owner says so.

A plain socket, not an asyncio transport: the event loop must neither read nor write between two exchanges.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from typing import Final

from aps.links.address import LinkAddress
from aps.links.link import Link
from aps.links.outbox import FrameQueue
from aps.timeouts import CONNECT_TIMEOUT_S, FIRST_RETRY_S, LONGEST_RETRY_S

RECEIVE_BUFFER_BYTES: Final = 4 * 1024 * 1024
"""Asked of the kernel (which may grant less), so that an autopilot never waits for us between two exchanges."""
MAX_WRITE_BYTES: Final = 8 * 1024
"""Written per exchange at most, in whole frames: an eighth of the smallest buffer that a kernel has for an autopilot
that reads, so that what is written does not depend on the state of that buffer. At 20 exchanges per second 160 kB/s."""
AT_ONCE_S: Final = 1.0
"""On loopback a port that listens takes a connection at once, and one that does not refuses it."""
_READ_BYTES: Final = 1 << 18

_log = logging.getLogger(__name__)


class HeldLink(Link):
    """One connection. Its owner reads, writes, and connects again when it is lost.

    Args:
        address: where to connect.
        limit_bytes: bound of the queue towards the autopilot.
    """

    def __init__(self, address: LinkAddress, limit_bytes: int) -> None:
        super().__init__(str(address), FrameQueue(limit_bytes), address.opening)
        self.address = address
        self.connections = 0
        self.receive_buffer_bytes = 0
        """What the kernel granted, its own overhead included."""
        self.lost_datagrams = 0
        """Of a link by UDP: what the kernel had no room for."""
        self._socket: socket.socket | None = None
        self._unsent = b""

    @property
    def up(self) -> bool:
        """Whether there is a connection (as far as the latest exchange could see)."""
        return self._socket is not None

    @property
    def unsent_bytes(self) -> int:
        """Taken for an earlier exchange, but refused by the kernel."""
        return len(self._unsent)

    async def connect(self) -> None:
        """Try, with back-off, until there is a connection; returns at once if there is one."""
        retry_s, told = FIRST_RETRY_S, False
        while self._socket is None:
            try:
                self._opened(await self._connected())
            except OSError as error:
                if not told:
                    _log.warning("no autopilot at %s yet (%s): trying again", self.address, error)
                told = True
                await asyncio.sleep(retry_s)
                retry_s = min(retry_s * 2.0, LONGEST_RETRY_S)

    def connect_now(self) -> bool:
        """Try once, and wait for nobody, as one may whose peer is held on this machine; returns whether it is up."""
        if self._socket is None:
            try:
                connection = socket.create_connection((self.address.host, self.address.port), AT_ONCE_S)
            except OSError:
                return False
            connection.setblocking(False)
            _set_up(connection)
            self._opened(connection)
        return True

    async def _connected(self) -> socket.socket:
        loop = asyncio.get_running_loop()
        places = await loop.getaddrinfo(self.address.host, self.address.port, type=socket.SOCK_STREAM)
        failure = OSError("no address")
        for family, kind, protocol, _, place in places:
            connection = socket.socket(family, kind, protocol)
            try:
                connection.setblocking(False)
                _set_up(connection)
                async with asyncio.timeout(CONNECT_TIMEOUT_S):
                    await loop.sock_connect(connection, place)
            except OSError as error:
                connection.close()
                failure = error
            except BaseException:
                connection.close()
                raise
            else:
                return connection
        raise failure

    def _opened(self, connection: socket.socket) -> None:
        self._socket, self._unsent = connection, b""
        self.receive_buffer_bytes = connection.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        self.connections += 1
        self.outbox.admit()
        _log.info("connected to the autopilot at %s", self.address)

    def read(self) -> bytes:
        """All that the autopilot has written; the connection may be down afterwards."""
        pieces: list[bytes] = []
        size = 0
        while self._socket is not None and size < 2 * RECEIVE_BUFFER_BYTES:  # else it writes while we read
            try:
                piece = self._socket.recv(_READ_BYTES)
            except (BlockingIOError, InterruptedError):
                break
            except OSError as error:
                self._lost(error)
                break
            if not piece:
                self._lost(None)
                break
            pieces.append(piece)
            size += len(piece)
        return b"".join(pieces)

    def take(self) -> bytes:
        """The frames for this exchange."""
        return self.outbox.take(MAX_WRITE_BYTES) if len(self._unsent) < MAX_WRITE_BYTES else b""

    def write(self, data: bytes) -> bool:
        """Write what the kernel refused before, then ``data``; returns whether it took everything."""
        if self._socket is None:
            return True
        self._unsent += data
        if not self._unsent:
            return True
        try:
            self._unsent = self._unsent[self._socket.send(self._unsent) :]
        except (BlockingIOError, InterruptedError):
            return False
        except OSError:
            self._unsent = b""  # the connection is gone, which shows at the next read
        return not self._unsent

    def _lost(self, error: OSError | None) -> None:
        _log.warning("connection to the autopilot at %s lost%s", self.address, f" ({error})" if error else "")
        self.close()

    def close(self) -> None:
        """Drop the connection, if there is one."""
        if self._socket is not None:
            self._socket.close()
        self._socket, self._unsent = None, b""
        self.outbox.close()


def _set_up(connection: socket.socket) -> None:
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
