"""The UA of an exchange that PX4 flies: their ports and connections in the exchange's loop."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Protocol

from fdm.clock.events import EventKind
from fdm.exchange.px4.callers import Newcomer
from fdm.exchange.px4.idle_core import IdleCores
from fdm.exchange.px4.seat import Px4Seat
from fdm.exchange.settings import core_count

LOOK_PERIOD_NS = 1_000_000
"""Wall time between two looks whether PX4 is at rest."""


class Hears(Protocol):
    """What acts on what PX4 does: the service of an exchange."""

    def welcome_px4(self, seat: Px4Seat, newcomer: Newcomer) -> None:
        """PX4 has connected."""

    def hear_px4(self, seat: Px4Seat) -> None:
        """PX4 has sent something, or may be at rest."""

    def excuse_px4(self, seat: Px4Seat) -> None:
        """PX4 has not been sent its frame yet."""

    def tell_px4(self, seat: Px4Seat, kind: EventKind) -> None:
        """Something about PX4 is to be told."""


class Px4Seats:
    """All seats of PX4.

    Args:
        service: acts.
        listen: has the loop call something when a file descriptor can be read.
        forget: takes that back.

    Attributes:
        cores: where they fly.
    """

    def __init__(
        self,
        service: Hears,
        listen: Callable[[int, Callable[[], object]], object],
        forget: Callable[[int], object],
    ) -> None:
        self._service, self._listen, self._forget = service, listen, forget
        self._seats: list[Px4Seat] = []
        self._may_be_eager = core_count() > 1
        self.cores = IdleCores(listen, forget)

    def add(self, seat: Px4Seat) -> None:
        """Serve it."""
        self._seats.append(seat)
        self._listen(seat.callers.sock.fileno(), partial(self._connects, seat))

    @property
    def are_due(self) -> bool:
        """Whether an answer may come any moment, and there is a core to spare for who waits for it."""
        return self._may_be_eager and any(seat.member.live and seat.wants_look() for seat in self._seats)

    def wake_at_ns(self, wall_ns: int, otherwise_ns: int) -> int:
        """Wall instant of the next look, or `otherwise_ns` if that is earlier."""
        if any(seat.wants_look() for seat in self._seats):
            return min(otherwise_ns, wall_ns + LOOK_PERIOD_NS)
        return otherwise_ns

    def go_on(self) -> None:
        """Send the frames that wait for a PX4 to be at rest, or for its turn; all who may have stepped."""
        for seat in self._seats:
            seat.end_turn()
        for seat in self._seats:
            if not seat.go_on():
                self._service.excuse_px4(seat)

    def look(self) -> None:
        """See who is at rest by now."""
        for seat in self._seats:
            seat.go_on()
            if seat.wants_look():
                self._hear(seat)

    def close(self) -> None:
        """Before any seat is closed: a PX4 whose connection has ended spins, and nothing else on its core can end."""
        self.cores.close()

    def _connects(self, seat: Px4Seat) -> None:
        newcomer = seat.accept()
        if newcomer is None:
            return
        self._let_go(seat)
        self._service.welcome_px4(seat, newcomer)
        self._listen(newcomer.connection.fileno(), partial(self._says, seat))

    def _says(self, seat: Px4Seat) -> None:
        if seat.receive(reads=1):  # what is left shows again
            self._hear(seat)
        else:
            self._let_go(seat)

    def _hear(self, seat: Px4Seat) -> None:
        if seat.is_lockstep:
            self._service.hear_px4(seat)
            if seat.take_silence():
                self._service.tell_px4(seat, EventKind.SILENT)
        else:
            self._service.tell_px4(seat, EventKind.REFUSED)
            if seat.connection is not None:
                self._forget(seat.connection.fileno())
            seat.retire()

    def _let_go(self, seat: Px4Seat) -> None:
        """Close a connection that has ended, or gives way to another."""
        if seat.connection is not None:
            self._forget(seat.connection.fileno())
            seat.drop()
