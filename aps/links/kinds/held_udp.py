"""The UDP link to an autopilot that is held (PX4): a port of ours, read and written only when its owner says so."""

from __future__ import annotations

import logging
import socket
import struct
from collections.abc import Iterator
from typing import Any, Final

from aps.links.address import LinkAddress
from aps.links.kinds.held import RECEIVE_BUFFER_BYTES, HeldLink

__all__ = ["HeldUdpLink", "datagrams_of"]

DATAGRAM_BYTES: Final = 1400
_READ_BYTES: Final = 1 << 16
_SO_RXQ_OVFL: Final = 40
"""Linux: with each datagram comes how many the kernel has had to drop before it."""
_MAGIC_2: Final = 0xFD
_MAGIC_1: Final = 0xFE
_SIGNED: Final = 0x01

_log = logging.getLogger(__name__)


class HeldUdpLink(HeldLink):
    """Whoever first sends MAVLink to the port is the autopilot.

    It counts as connected as soon as the port is bound; what is to be said waits until the autopilot has spoken.

    Args:
        address: the port to listen on; 0 takes any free one, see ``port``.
        limit_bytes: bound of the queue towards the autopilot.
    """

    def __init__(self, address: LinkAddress, limit_bytes: int) -> None:
        super().__init__(address, limit_bytes)
        self.foreign_datagrams = 0
        """From others than the autopilot: not read."""
        self._peer: Any = None
        self._dropped = 0

    @property
    def port(self) -> int:
        """The port that it listens on.

        Raises:
            RuntimeError: it is not bound yet.
        """
        if self._socket is None:
            raise RuntimeError("the port is not open yet")
        port: int = self._socket.getsockname()[1]
        return port

    async def connect(self) -> None:
        """Bind the port, unless it is bound.

        Raises:
            OSError: the port is taken.
        """
        self.connect_now()

    def connect_now(self) -> bool:
        """As `connect`."""
        if self._socket is not None:
            return True
        place = (self.address.host, self.address.port)
        family, kind, protocol, _, where = socket.getaddrinfo(*place, type=socket.SOCK_DGRAM)[0]
        opened = socket.socket(family, kind, protocol)
        try:
            opened.setblocking(False)
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
            opened.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
            opened.bind(where)
        except OSError as error:
            opened.close()
            text = f"error while attempting to bind on address {place!r}: {error.strerror}"
            raise OSError(error.errno, text) from error
        self._peer, self._dropped = None, 0
        self._opened(opened)
        return True

    def read(self) -> bytes:
        """All that the autopilot has sent; ``lost_datagrams`` says whether that is everything."""
        pieces: list[bytes] = []
        size = 0
        while self._socket is not None and size < 2 * RECEIVE_BUFFER_BYTES:
            try:
                piece, ancillary, _, place = self._socket.recvmsg(_READ_BYTES, socket.CMSG_SPACE(4))
            except (BlockingIOError, InterruptedError):
                break
            except ConnectionRefusedError:
                continue  # of a datagram of ours: nobody listens there at the moment
            self._count_dropped(ancillary)
            if self._is_from_autopilot(piece, place):
                pieces.append(piece)
                size += len(piece)
        return b"".join(pieces)

    def _count_dropped(self, ancillary: list[tuple[int, int, bytes]]) -> None:
        for level, kind, data in ancillary:
            if level == socket.SOL_SOCKET and kind == _SO_RXQ_OVFL:
                (dropped,) = struct.unpack("I", data)
                self.lost_datagrams += (dropped - self._dropped) & 0xFFFFFFFF
                self._dropped = dropped

    def _is_from_autopilot(self, piece: bytes, place: Any) -> bool:
        if self._peer is None and piece[:1] in (b"\xfd", b"\xfe"):
            self._peer = place
            _log.info("the autopilot of %s speaks from port %d", self.address, place[1])
        self.foreign_datagrams += place != self._peer
        return bool(place == self._peer)

    def take(self) -> bytes:
        """The frames for this exchange; none before the autopilot has spoken."""
        return b"" if self._peer is None else super().take()

    def write(self, data: bytes) -> bool:
        """Send what the kernel refused before, then ``data``; returns whether it took everything."""
        if self._socket is None or self._peer is None:
            return True
        waiting, self._unsent = self._unsent + data, b""
        for datagram in datagrams_of(waiting):
            try:
                self._socket.sendto(datagram, self._peer)
            except (BlockingIOError, InterruptedError):
                self._unsent = waiting
                return False
            except ConnectionRefusedError:
                pass  # of the datagram before: nobody listens there at the moment, which shows at the next read
            waiting = waiting[len(datagram) :]
        return True


def datagrams_of(data: bytes) -> Iterator[bytes]:
    """Whole frames in as few datagrams as hold them; what is no frame goes as it is."""
    begin = end = 0
    while end < len(data):
        after = end + _frame_bytes(data, end)
        if after - begin > DATAGRAM_BYTES and end > begin:
            yield data[begin:end]
            begin = end
        end = after
    if begin < len(data):
        yield data[begin:]


def _frame_bytes(data: bytes, at: int) -> int:
    """Bytes of the frame that begins there; all that is left, if none does."""
    magic, left = data[at], len(data) - at
    if left < 3 or magic not in (_MAGIC_1, _MAGIC_2):
        return left
    signature = 13 if magic == _MAGIC_2 and data[at + 2] & _SIGNED else 0
    return min(left, data[at + 1] + (12 if magic == _MAGIC_2 else 8) + signature)
