"""Stop and wait with one alternating bit, as ExpressLRS sends data: a chunk in numbered fragments.

A fragment is sent again until the confirmation bit that comes back has turned. Fragments are numbered from 1 on in
each chunk, the last has the number 0; a chunk of one fragment is followed by an empty one with 0. After too many
confirmations of the wrong value the chunk is dropped, and the bits are set right by resync frames.

The faults of the original are kept. A receiver takes a repeated fragment 1 for a new start and turns its bit, so that
the repetition has to come twice. A fragment that is repeated with another length (beside link statistics there is
less room) leaves the two ends at different places: the chunk arrives damaged, or is resynced though it came.
"""

from __future__ import annotations

from enum import Enum, auto
from typing import NamedTuple


class Fragment(NamedTuple):
    """A part of a chunk: its number, and which bytes it has."""

    number: int
    first: int = 0
    length: int = 0


NOTHING = Fragment(0)


class _State(Enum):
    IDLE = auto()
    LOADED = auto()
    SENDING = auto()
    CLOSING = auto()
    RESYNC = auto()


class StubbornSender:
    """One end.

    Args:
        resync_number: of fragments that say: forget what you have.
        patience: confirmations of the wrong value in a row, beyond which it resyncs.
    """

    def __init__(self, resync_number: int, patience: int) -> None:
        self._resync_number, self._patience = resync_number, patience
        self._state = _State.IDLE
        self._length = self._place = self._number = self._sent = self._waited = 0
        self._wants = True

    @property
    def is_idle(self) -> bool:
        """Whether it can take a chunk."""
        return self._state is _State.IDLE

    @property
    def resyncs(self) -> bool:
        """Whether it has dropped its chunk and sets the bits right."""
        return self._state is _State.RESYNC

    def load(self, length_bytes: int) -> None:
        """Begin with a chunk."""
        self._length, self._place, self._number, self._waited = length_bytes, 0, 1, 0
        self._state = _State.LOADED

    def fragment(self, room_bytes: int) -> Fragment:
        """What to send now."""
        self._sent = 0
        if self._state is _State.RESYNC:
            return Fragment(self._resync_number)
        if self._state in (_State.IDLE, _State.CLOSING):
            return NOTHING
        self._state = _State.SENDING
        self._sent = min(room_bytes, self._length - self._place)
        is_last = self._number > 1 and self._place + self._sent >= self._length
        return Fragment(0 if is_last else self._number, self._place, self._sent)

    def confirm(self, bit: bool) -> None:
        """A confirmation bit came."""
        if self._state in (_State.IDLE, _State.LOADED):
            return
        if bit is not self._wants:
            self._wait(bit)
            return
        self._wants = not bit
        if self._state is not _State.SENDING:
            self._state = _State.IDLE
            return
        self._waited = 0
        self._place += self._sent
        if self._place >= self._length:
            self._state = _State.CLOSING if self._number == 1 else _State.IDLE
        self._number += 1

    def _wait(self, bit: bool) -> None:
        if self._state is _State.RESYNC:
            return
        self._waited += 1
        if self._waited > self._patience:
            self._wants, self._state = not bit, _State.RESYNC


class StubbornReceiver:
    """The other end.

    Args:
        resync_number: as its sender's.

    Attributes:
        bit: that it sends back.
    """

    def __init__(self, resync_number: int) -> None:
        self._resync_number = resync_number
        self.bit = False
        self._parts: list[Fragment] = []

    def take(self, fragment: Fragment) -> list[Fragment] | None:
        """A fragment came; returns those of a chunk that it completes."""
        number, next_number = fragment.number, len(self._parts) + 1
        if number == self._resync_number:
            self._parts, self.bit = [], not self.bit
            return None
        if number == 1 and next_number > 1:
            self._parts = []
        elif number != next_number and not (number == 0 and next_number > 1):
            return None
        self._parts.append(fragment)
        self.bit = not self.bit
        if number:
            return None
        parts, self._parts = self._parts, []
        return parts


def are_whole(parts: list[Fragment], length_bytes: int) -> bool:
    """Whether fragments are all bytes of a chunk, each once."""
    place = 0
    for _, first, length in parts:
        if length and first != place:
            return False
        place += length
    return place == length_bytes
