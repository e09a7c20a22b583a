"""What the ways to a modem's host have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

OnData = Callable[[bytes, object], None]
"""Takes bytes, and whose they are: of one connection, say."""


def _nobody(data: bytes, host: object) -> None:
    """Bytes before anybody wants them."""


def _quiet(text: str) -> None:
    """What nobody wants to hear."""


class Endpoint(ABC):
    """One serial port's worth of bytes, to and from a program.

    Args:
        name: how it is written.

    Attributes:
        on_data: called with what a host sends.
        tell: called with what a user should know.
        unread_bytes: for the host, and not taken: nobody was there, or nobody read.
        connections: how often a host came.
    """

    can_wait = True
    """Whether a host that is not read waits; else what it sends meanwhile is lost."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.on_data: OnData = _nobody
        self.tell: Callable[[str], None] = _quiet
        self.unread_bytes = 0
        self.connections = 0
        self.is_held = False

    @abstractmethod
    async def open(self) -> None:
        """Begin; the name then has the port or device that it got.

        Raises:
            OSError: the port is in use, or there is no such device or address.
        """

    @property
    def hosts(self) -> int:
        """How many may be sending now."""
        return 1

    @abstractmethod
    def write(self, data: bytes) -> None:
        """Give bytes to the host; if it does not take them they are counted, and gone."""

    def write_all(self, pieces: Sequence[bytes]) -> None:
        """Give several pieces to the host, at once if it takes a stream."""
        if pieces:
            self.write(b"".join(pieces))

    @abstractmethod
    async def close(self) -> None:
        """End, and leave nothing open."""

    def hold(self) -> None:
        """Read no more for now."""
        if not self.is_held:
            self.is_held = True
            self._hold()

    def go_on(self) -> None:
        """Read again."""
        if self.is_held:
            self.is_held = False
            self._go_on()

    @abstractmethod
    def _hold(self) -> None:
        """Stop reading, if that can be."""

    @abstractmethod
    def _go_on(self) -> None:
        """Read again."""
