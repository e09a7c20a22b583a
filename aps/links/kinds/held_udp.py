"""The UDP link to an autopilot that is held (PX4): a port of ours, read and written only when its owner says so."""

from __future__ import annotations

import logging
import socket
import struct
import sys
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

from aps.links.address import LinkAddress
from aps.links.kinds.held import RECEIVE_BUFFER_BYTES, HeldLink

DATAGRAM_BYTES: Final = 1400
_READ_BYTES: Final = 1 << 16
_OVERHEAD_BYTES: Final = 512
"""What each datagram counts besides its bytes, of what is read in one turn: less than the kernel's own overhead."""
_SO_RXQ_OVFL: Final = 40
"""Linux: with each datagram comes how many the kernel has had to drop before it. Elsewhere they are not counted."""
_MAGIC_2: Final = 0xFD
_MAGIC_1: Final = 0xFE
_SIGNED: Final = 0x01

_log = logging.getLogger(__name__)


class HeldUdpLink(HeldLink):
    """The autopilot is who sends from the port that is known for its own, or whoever first sends MAVLink.

    The kernel keeps what others send away from then on. One that was not known, and whose port is closed, is forgotten:
    it may begin anew from another. The link counts as connected as soon as the port is bound; what is to be said waits
    until the autopilot has spoken.

    Args:
        address: the port to listen on; 0 takes any free one, see ``port``.
        limit_bytes: bound of the queue towards the autopilot.
        peer: host and port from which the autopilot sends, if that is known.
    """

    def __init__(self, address: LinkAddress, limit_bytes: int, peer: tuple[str, int] | None = None) -> None:
        super().__init__(address, limit_bytes)
        self.foreign_datagrams = 0
        """From others than the autopilot: not read."""
        self.known_peer = peer
        """Where the autopilot sends from, if that was said."""
        self._peer: Any = None
        self._has_spoken = False
        self._dropped = 0
        self._is_refused = False
        """Whether nobody listens at the autopilot's port."""
        self._error: OSError | None = None
        """Why a datagram of ours could not be sent."""

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
            if sys.platform == "linux":
                opened.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
            opened.bind(where)
        except OSError as error:
            opened.close()
            text = f"error while attempting to bind on address {place!r}: {error.strerror}"
            raise OSError(error.errno, text) from error
        self._peer, self._has_spoken, self._dropped = None, False, 0
        self._is_refused, self._error = False, None
        if self.known_peer is not None:
            self._peer = socket.getaddrinfo(*self.known_peer, family, socket.SOCK_DGRAM)[0][4]
            opened.connect(self._peer)
        self._opened(opened)
        return True

    def read(self) -> bytes:
        """All that the autopilot has sent; ``lost_datagrams`` says whether that is everything."""
        pieces: list[bytes] = []
        size, error = 0, self._error
        while (
            self._socket is not None and size < 2 * RECEIVE_BUFFER_BYTES
        ):  # whoever goes on sending does not hold us
            size += _OVERHEAD_BYTES
            try:
                piece, ancillary, _, place = self._socket.recvmsg(_READ_BYTES, socket.CMSG_SPACE(4))
            except (BlockingIOError, InterruptedError):
                break
            except ConnectionRefusedError:
                self._is_refused = True  # of a datagram of ours
                continue
            except OSError as failure:
                error = failure
                break
            size += len(piece)
            self._count_dropped(ancillary)
            if self._is_from_autopilot(piece, place):
                pieces.append(piece)
        if error is not None:
            self._lost(error)
        elif self._is_refused:
            self._forget()
        return b"".join(pieces)

    def _forget(self) -> None:
        """Nobody listens where the autopilot was: unless its port is known, it may come back from another."""
        self._is_refused = False
        if self.known_peer is None and self._socket is not None:
            _log.info("the autopilot of %s is gone from port %d", self.address, self._peer[1])
            place, self.address = self.address, replace(self.address, port=self.port)
            self._socket.close()
            self._socket = None
            try:
                self.connect_now()
            except OSError as error:
                self._lost(error)
            self.address = place

    def _count_dropped(self, ancillary: list[tuple[int, int, bytes]]) -> None:
        for level, kind, data in ancillary:
            if level == socket.SOL_SOCKET and kind == _SO_RXQ_OVFL:
                (dropped,) = struct.unpack("I", data)
                self.lost_datagrams += (dropped - self._dropped) & 0xFFFFFFFF
                self._dropped = dropped

    def _is_from_autopilot(self, piece: bytes, place: Any) -> bool:
        speaks = piece[:1] in (b"\xfd", b"\xfe")
        if self._peer is None and speaks and self._socket is not None:
            self._peer = place
            self._socket.connect(place)
            _log.info("the autopilot of %s speaks from port %d", self.address, place[1])
        self._has_spoken |= speaks and place == self._peer
        self.foreign_datagrams += place != self._peer
        return bool(place == self._peer)

    def take(self) -> bytes:
        """The frames for this exchange; none before the autopilot has spoken."""
        return super().take() if self._has_spoken else b""

    def write(self, data: bytes) -> bool:
        """Send what the kernel refused before, then ``data``; returns whether it took everything."""
        if self._socket is None or self._peer is None:
            return True
        waiting, self._unsent = self._unsent + data, b""
        for datagram in datagrams_of(waiting):
            try:
                self._socket.send(datagram)
            except (BlockingIOError, InterruptedError):
                self._unsent = waiting
                return False
            except ConnectionRefusedError:
                self._is_refused = True  # of the datagram before: nobody listens there at the moment
            except OSError as error:
                self._error = error  # the link is lost, which shows at the next read
                break
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
