"""Who connects to the port of a UA that PX4 flies."""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable
from typing import NamedTuple

from fdm.exchange.hosted_aircraft import ExchangedAircraft
from fdm.exchange.px4.peer import Peer, peer_of

NOT_CONNECTED = "connections_failed"
"""Counter of the connections that had ended before they were taken, or could not be."""
NOT_TAKEN = "connections_refused"
"""Counter of the connections that are not served as another one is flown."""
KEPT_MAX = 8
"""Connections of other PX4 that stay open, unserved, until the seat is closed."""
_READ_BYTES = 4096
_log = logging.getLogger(__name__)


class Newcomer(NamedTuple):
    """Who has connected, and is to be served."""

    connection: socket.socket
    peer: Peer


class Callers:
    """A port that listens, and the connections at it that are not served.

    Args:
        sock: the port; this one's from now on.
        aircraft: counts them.

    Attributes:
        sock: the port.
    """

    def __init__(self, sock: socket.socket, aircraft: ExchangedAircraft) -> None:
        self.sock, self._aircraft = sock, aircraft
        self._kept: list[socket.socket] = []

    def next(self, keeps_from: Callable[[Peer], bool]) -> Newcomer | None:
        """Who has connected, if that is who is to be served from now on. Never raises.

        Args:
            keeps_from: whether who is served stays, and the newcomer has to go.
        """
        connection = None
        try:
            connection, address = self.sock.accept()
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.setblocking(False)
            newcomer = Newcomer(connection, peer_of(connection))
        except BlockingIOError:
            return None
        except OSError as error:
            self._turn_away(connection, NOT_CONNECTED, error)
            return None
        if keeps_from(newcomer.peer):
            self._refuse(newcomer, address)
            return None
        return newcomer

    def _refuse(self, newcomer: Newcomer, address: object) -> None:
        """Leave a PX4 that cannot be flown connected, for the reason that `Px4Seat.retire` has; close what is none."""
        self._kept = [each for each in self._kept if not _has_ended(each)]
        if newcomer.peer.is_px4 and len(self._kept) < KEPT_MAX:
            self._aircraft.count(NOT_TAKEN)
            self._kept.append(newcomer.connection)
        else:
            self._turn_away(newcomer.connection, NOT_TAKEN, f"{address} (process {newcomer.peer.pid})")

    def _turn_away(self, connection: socket.socket | None, counter: str, why: object) -> None:
        self._aircraft.count(counter)
        _log.debug("UA %d: %s: %s", self._aircraft.ua_id, counter, why)
        if connection is not None:
            connection.close()

    def close(self) -> None:
        """Close the port, and what was left open."""
        for connection in self._kept:
            connection.close()
        self.sock.close()


def _has_ended(connection: socket.socket) -> bool:
    """Whether nobody has the other end any more; closes ours then."""
    try:
        if connection.recv(_READ_BYTES):
            return False
    except BlockingIOError:
        return False
    except OSError as error:
        _log.debug("a connection that is not served: %s", error)
    connection.close()
    return True
