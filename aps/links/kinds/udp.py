"""Links over UDP: to a port that is known, and from whoever sends to ours."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections.abc import Callable
from typing import Any, Final

from aps.links.address import LinkAddress
from aps.links.link import Link, LinkOwner
from aps.links.outbox import FrameQueue
from aps.timeouts import PEER_SILENCE_S, UDP_RETRY_S

DATAGRAM_BYTES: Final = 1400
"""Frames are packed into datagrams that fit an Ethernet frame."""
SEND_BUFFER_BYTES: Final = 1 << 18

_log = logging.getLogger(__name__)


class DatagramOutbox(FrameQueue):
    """Sends whole frames in datagrams, at once: a datagram never waits for its reader."""

    def __init__(self, limit_bytes: int, send: Callable[[bytes], bool]) -> None:
        super().__init__(limit_bytes)
        self._send = send

    def put_all(self, frames: list[bytes], size_bytes: int) -> None:
        """Send several frames at once, if they fit into a datagram and nothing waits: they need not be queued."""
        if self.waiting or size_bytes > DATAGRAM_BYTES or not self._open:
            super().put_all(frames, size_bytes)
            return
        counters = self.counters
        counters.queued_frames += len(frames)
        counters.written_frames += len(frames)
        counters.written_bytes += size_bytes
        if not self._send(b"".join(frames)):
            counters.dropped_full += 1

    def flush(self) -> None:
        """Send all that waits."""
        while self.waiting:
            if not self._send(self.take(DATAGRAM_BYTES)):
                self.counters.dropped_full += 1


class UdpLink(Link):
    """One UDP peer."""

    def __init__(
        self,
        name: str,
        address: LinkAddress,
        limit_bytes: int,
        send: Callable[[bytes], bool],
        forget: Callable[[], None],
    ) -> None:
        super().__init__(name, DatagramOutbox(limit_bytes, send), address.opening, connectionless=True)
        self._forget = forget
        self.outbox.admit()

    @property
    def can_wait(self) -> bool:
        """A datagram that is not read is lost."""
        return False

    def abort(self) -> None:
        """Forget the peer."""
        self._forget()


class _Datagrams(asyncio.DatagramProtocol):
    """Hands on what asyncio reports."""

    def __init__(self, on_data: Callable[[bytes, Any], None]) -> None:
        self._on_data = on_data

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """asyncio: a datagram came."""
        self._on_data(data, addr)

    def error_received(self, exc: Exception) -> None:
        """asyncio: nobody listens there (yet); UDP does not care, and the next datagram may arrive."""
        _log.debug("UDP: %s", exc)


class UdpSender:
    """One link to a port that is known: it is there from the start, whether anybody listens or not.

    The socket is connected, so that only that peer is heard; of a broadcast address, whoever answers.
    """

    def __init__(self, address: LinkAddress, owner: LinkOwner, limit_bytes: int) -> None:
        self.address = address
        self._owner, self._limit_bytes = owner, limit_bytes
        self._transport: asyncio.DatagramTransport | None = None
        self._socket: socket.socket | None = None
        self._to: Any = None
        """Of a socket that is not connected."""
        self._link: UdpLink | None = None
        self._heard_s: float | None = None

    async def start(self) -> None:
        """Open now if the peer's name can be looked up; ``run`` tries again."""
        with contextlib.suppress(OSError):
            await self._open()

    async def run(self) -> None:
        """Open, and keep open until cancelled."""
        told = False
        while self._transport is None:
            try:
                await self._open()
            except OSError as error:
                if not told:
                    _log.warning("cannot send to %s yet (%s): trying again", self.address, error)
                told = True
                await asyncio.sleep(UDP_RETRY_S)
        while True:
            await asyncio.sleep(PEER_SILENCE_S / 4)
            self._renew(asyncio.get_running_loop().time())

    async def _open(self) -> None:
        self._socket, self._to = await _socket_to(self.address.host, self.address.port)
        self._transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: _Datagrams(self._received), sock=self._socket
        )
        self._new_link()

    def _new_link(self) -> None:
        link = UdpLink(str(self.address), self.address, self._limit_bytes, self._send, lambda: None)
        self._heard_s = None
        self._link = link if self._owner.link_opened(link) else None

    def _renew(self, now_s: float) -> None:
        """A peer that has been silent for long is gone; the next one that is heard there is another."""
        if self._link is None or (self._heard_s is not None and now_s - self._heard_s > PEER_SILENCE_S):
            self._end_link()
            self._new_link()

    def _end_link(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.outbox.close()
            self._owner.link_closed(link, None)

    def _send(self, data: bytes) -> bool:
        """Send now; returns whether the system took it."""
        if self._socket is None:
            return False
        try:
            # asyncio's own way costs as much again
            _ = self._socket.send(data) if self._to is None else self._socket.sendto(data, self._to)
        except ConnectionRefusedError:
            return True  # of the datagram before: nobody listens there (yet), which UDP does not mind
        except OSError as error:
            _log.debug("UDP: %s", error)
            return False
        return True

    def _received(self, data: bytes, _: Any) -> None:
        self._heard_s = asyncio.get_running_loop().time()
        if self._link is not None:
            self._owner.link_data(self._link, data)

    def close(self) -> None:
        """Close the socket."""
        if self._transport is not None:
            self._transport.close()
        self._transport = self._socket = None
        self._end_link()


async def _socket_to(host: str, port: int) -> tuple[socket.socket, Any]:
    """A socket that is connected; to a broadcast address one that is not, and where it is to send."""
    loop = asyncio.get_running_loop()
    places = await loop.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
    family, kind, protocol, _, place = places[0]
    connection = socket.socket(family, kind, protocol)
    try:
        connection.setblocking(False)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        try:
            connection.connect(place)
        except PermissionError:  # what the system says of a broadcast address to who has not asked for one
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            with contextlib.suppress(OSError):  # Linux has bound it
                connection.bind(("", 0))
            return connection, place
    except BaseException:
        connection.close()
        raise
    return connection, None


class UdpListener:
    """A port of ours: whoever sends to it is a link, until it has been silent for long."""

    def __init__(self, address: LinkAddress, owner: LinkOwner, limit_bytes: int) -> None:
        self.address = address
        self.turned_away = 0
        self._owner, self._limit_bytes = owner, limit_bytes
        self._transport: asyncio.DatagramTransport | None = None
        self._peers: dict[Any, UdpLink] = {}
        self._heard_s: dict[Any, float] = {}

    @property
    def port(self) -> int:
        """The port that it listens on (useful when 0 was asked for)."""
        if self._transport is None:
            raise RuntimeError("the socket is not open yet")
        port: int = self._transport.get_extra_info("sockname")[1]
        return port

    async def start(self) -> None:
        """Begin to listen.

        Raises:
            OSError: as from ``bind``; EADDRINUSE when the port is taken.
        """
        place = (self.address.host, self.address.port)
        try:
            self._transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
                lambda: _Datagrams(self._heard), local_addr=place
            )
        except OSError as error:  # asyncio names the address of a TCP server only
            text = f"error while attempting to bind on address {place!r}: {error.strerror}"
            raise OSError(error.errno, text) from error

    async def run(self) -> None:
        """Forget silent peers, until cancelled."""
        try:
            while True:
                await asyncio.sleep(PEER_SILENCE_S / 4)
                self._forget_silent(asyncio.get_running_loop().time())
        finally:
            self.close()

    def _forget_silent(self, now_s: float) -> None:
        for place in [place for place, heard_s in self._heard_s.items() if now_s - heard_s > PEER_SILENCE_S]:
            self._forget(place)

    def _heard(self, data: bytes, place: Any) -> None:
        link = self._peers.get(place)
        if link is None:
            link = UdpLink(
                f"{place[0]}:{place[1]}",
                self.address,
                self._limit_bytes,
                lambda data: self._send(data, place),
                lambda: self._forget(place),
            )
            if not self._owner.link_opened(link):
                return
            self._peers[place] = link
        self._heard_s[place] = asyncio.get_running_loop().time()
        self._owner.link_data(link, data)

    def _send(self, data: bytes, place: Any) -> bool:
        if self._transport is None:
            return False
        self._transport.sendto(data, place)
        return True

    def _forget(self, place: Any) -> None:
        link = self._peers.pop(place, None)
        self._heard_s.pop(place, None)
        if link is not None:
            link.outbox.close()
            self._owner.link_closed(link, None)

    def close(self) -> None:
        """Close the socket, and with it all links."""
        for place in list(self._peers):
            self._forget(place)
        if self._transport is not None:
            self._transport.close()
