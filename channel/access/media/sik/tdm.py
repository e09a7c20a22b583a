"""The state machine of a SiK radio's time division, and its hopping: pure counting of ticks and channels.

Source: ArduPilot/SiK, `Firmware/radio/tdm.c` (`tdm_state_update`, `sync_tx_windows`) and `freq_hopping.c`.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple

from channel.access.media.sik.timing import SikTiming


class TdmState(IntEnum):
    """Whose turn it is; one follows the other."""

    TRANSMIT = 0
    SILENCE1 = 1
    RECEIVE = 2
    SILENCE2 = 3


OWN, OTHERS = TdmState.TRANSMIT, TdmState.RECEIVE


class Trailer(NamedTuple):
    """What a packet says about its sender's window.

    Attributes:
        window: ticks that will be left of it; 0: a statistics packet, which says nothing.
        bonus: whether the sender is in the receiver's window, which was yielded to it.
        is_empty: whether the packet has no data: its sender yields.
    """

    window: int
    bonus: bool
    is_empty: bool


class Tdm:
    """Windows of one radio.

    Args:
        timing: of windows and silences.
        phase: ticks since the start of the round, whose first part is the own window.
        on_turn: called with each new state.

    Attributes:
        state, remaining: which part of the round it is, and how many ticks are left of it.
        bonus: whether the other radio has yielded its window.
        yielded: whether the own window, or the bonus, is given up.
        wait: ticks before the next packet may start.
    """

    __slots__ = ("_on_turn", "_timing", "bonus", "remaining", "state", "wait", "yielded")

    def __init__(self, timing: SikTiming, phase: int, on_turn: Callable[[TdmState], object]) -> None:
        self._timing, self._on_turn = timing, on_turn
        self.state, self.remaining = TdmState.TRANSMIT, timing.window
        phase %= timing.round
        while phase >= self.remaining:
            phase -= self.remaining
            self._next()
        self.remaining -= phase
        self.bonus = self.yielded = False
        self.wait = 0

    @property
    def may_send(self) -> bool:
        """Whether the window is this radio's, by right or by bonus."""
        return self.state is OWN or (self.bonus and self.state is OTHERS)

    def until_own(self) -> int:
        """Ticks until the own window opens; 0: it is open."""
        timing, ticks, state = self._timing, self.remaining, self.state
        if state is OWN:
            return 0
        if state is TdmState.SILENCE1:
            ticks += timing.window
        return ticks if state is TdmState.SILENCE2 else ticks + timing.silence

    def advance(self, ticks: int) -> None:
        """Let ticks pass: whatever was granted or given up ends with its state."""
        self.wait = max(self.wait - ticks, 0)
        while ticks >= self.remaining:
            ticks -= self.remaining
            self._next()
            self.bonus = self.yielded = False
            self.wait = 0
            self._on_turn(self.state)
        self.remaining -= ticks

    def heard(self, trailer: Trailer) -> None:
        """Take the other radio's word for the time: each packet brings the two in step."""
        self.wait = 0
        if not trailer.window:
            return
        if not trailer.bonus:
            self.state, self.remaining = OTHERS, trailer.window
        elif self.state is TdmState.SILENCE1:
            self.remaining = self._timing.silence
        elif self.state is OWN:
            self.remaining = trailer.window
        else:
            self.state, self.remaining = TdmState.SILENCE2, 1
        self.bonus = self.state is OTHERS and trailer.is_empty
        if self.state is not OWN:
            self.yielded = False

    def _next(self) -> None:
        self.state = TdmState((self.state + 1) % 4)
        is_window = self.state is OWN or self.state is OTHERS
        self.remaining = self._timing.window if is_window else self._timing.silence


class Hopping:
    """Where a radio sends and listens.

    With lock it listens where it sends next; without, it stays while its transmitter goes once round.

    Args:
        order: channels one after the other.
        place: in the order, to begin with.
        locked: whether the other radio has been found.
    """

    __slots__ = ("_listens", "_order", "_sends", "locked")

    def __init__(self, order: tuple[int, ...], place: int, *, locked: bool) -> None:
        self._order, self.locked = order, locked
        self._sends = self._listens = place % len(order)

    @property
    def sends_on(self) -> int:
        """The channel of the transmitter."""
        return self._order[self._sends]

    @property
    def listens_on(self) -> int:
        """The channel of the receiver."""
        return self._order[self._listens]

    def hop(self) -> None:
        """The own window opens or closes."""
        count = len(self._order)
        self._sends = (self._sends + 1) % count
        if self.locked:
            self._listens = self._sends
        elif self._sends == 0:
            self._listens = (self._listens + 1) % count

    def found(self) -> None:
        """A packet came: the other radio sends on this channel."""
        self.locked, self._sends = True, self._listens

    def lost(self) -> None:
        """Nothing came for long: try the next channel."""
        self.locked, self._listens = False, (self._listens + 1) % len(self._order)
