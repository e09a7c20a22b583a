"""A host at the other end of a TCP connection."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from typing import Final, cast

from aps.timeouts import CONNECT_TIMEOUT_S, FIRST_RETRY_S, LONGEST_RETRY_S
from bridge.endpoints.endpoint import Endpoint

RECEIVE_BUFFER_BYTES: Final = 16_384
"""Asked of the kernel, so that a host that sends faster than its line soon waits, as at a UART. The kernel counts what
a segment takes of its memory: with 4 kB many short ones do not fit, are dropped, and come again much later."""
UNREAD_BYTES: Final = 1 << 16
"""For a host that does not read."""
BACKLOG: Final = 16
"""Connections accepted in one turn of the event loop."""
HOSTS_MAX: Final = 64
"""At one port: each holds a file descriptor of the whole process."""


class _Stream(asyncio.Protocol):
    """One connection."""

    def __init__(self, endpoint: _Tcp) -> None:
        self._endpoint = endpoint
        self.transport: asyncio.Transport | None = None
        self.ended = asyncio.Event()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """asyncio: it is there."""
        self.transport = cast(asyncio.Transport, transport)
        connection = transport.get_extra_info("socket")
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        self._endpoint.came(self)

    def data_received(self, data: bytes) -> None:
        """asyncio: bytes came."""
        self._endpoint.on_data(data, self)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 (that it went is enough)
        """asyncio: it is gone."""
        self._endpoint.went(self)
        self.ended.set()


class _Tcp(Endpoint):
    """Bytes go to all that are connected."""

    def __init__(self, name: str, host: str, port: int) -> None:
        super().__init__(name)
        self._host, self._port = host, port
        self._streams: set[_Stream] = set()

    def came(self, stream: _Stream) -> None:
        """A connection is there."""
        self._streams.add(stream)
        self.connections += 1
        if self.is_held and stream.transport is not None:
            stream.transport.pause_reading()

    def went(self, stream: _Stream) -> None:
        """It has gone."""
        self._streams.discard(stream)

    @property
    def hosts(self) -> int:
        """Those that are connected."""
        return len(self._streams)

    def write(self, data: bytes) -> None:
        """To all that are connected."""
        taken = False
        for stream in self._streams:
            if stream.transport is not None and stream.transport.get_write_buffer_size() < UNREAD_BYTES:
                stream.transport.write(data)
                taken = True
        self.unread_bytes += 0 if taken else len(data)

    def _hold(self) -> None:
        for stream in self._streams:
            if stream.transport is not None:
                stream.transport.pause_reading()

    def _go_on(self) -> None:
        for stream in self._streams:
            if stream.transport is not None:
                stream.transport.resume_reading()

    def _abort(self) -> None:
        for stream in self._streams:
            if stream.transport is not None:
                stream.transport.abort()


class TcpConnection(_Tcp):
    """Connects, and again when the host has gone."""

    def __init__(self, name: str, host: str, port: int) -> None:
        super().__init__(name, host, port)
        self._task: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Begin to connect; nobody has to be there yet."""
        self._task = asyncio.create_task(self._keep())

    async def close(self) -> None:
        """Stop connecting, and drop the connection."""
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task
        self._abort()

    async def _keep(self) -> None:
        retry_s, has_told = FIRST_RETRY_S, False
        while True:
            try:
                async with asyncio.timeout(CONNECT_TIMEOUT_S):
                    stream = await self._connected()
            except OSError as error:
                if not has_told:
                    self.tell(f"nobody at {self.name} yet ({error}): start it, it is tried again and again")
                has_told = True
            else:
                self.tell(f"connected to {self.name}")
                retry_s, has_told = FIRST_RETRY_S, False
                await stream.ended.wait()
                self.tell(f"{self.name} has closed its connection: connecting again")
            await asyncio.sleep(retry_s)
            retry_s = min(2.0 * retry_s, LONGEST_RETRY_S)

    async def _connected(self) -> _Stream:
        loop = asyncio.get_running_loop()
        _, stream = await loop.create_connection(lambda: _Stream(self), self._host, self._port)
        return stream


class TcpPort(_Tcp):
    """Listens; each who connects gets everything, and all may send. One beyond `HOSTS_MAX` is turned away."""

    def __init__(self, name: str, host: str, port: int) -> None:
        super().__init__(name, host, port)
        self._server: asyncio.Server | None = None

    def came(self, stream: _Stream) -> None:
        """A connection is there."""
        if len(self._streams) < HOSTS_MAX:
            super().came(stream)
        elif stream.transport is not None:
            stream.transport.abort()

    async def open(self) -> None:
        """Listen."""
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(
            lambda: _Stream(self), self._host, self._port, backlog=BACKLOG
        )
        port = self._server.sockets[0].getsockname()[1]
        self.name = f"{self.name.rpartition(':')[0]}:{port}"

    async def close(self) -> None:
        """Stop listening, and drop all connections."""
        if self._server is not None:
            self._server.close()
        self._abort()
