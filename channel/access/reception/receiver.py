"""What one node hears of transmissions that overlap, piece by piece.

A receiver that is free locks on to the first signal that is strong enough, and follows it to its end; all other power
is interference, piecewise constant. Who transmits hears nothing. With capture, a signal that is stronger by enough
takes a locked receiver over.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import inf
from types import MappingProxyType
from typing import Protocol

from channel.access.agenda import SIGNAL_STARTS, Agenda, Entry
from channel.access.packets import AirFrame, Loss
from channel.access.reception.leaks import Leaks
from channel.access.world import Piece, World


@dataclass(frozen=True, slots=True)
class Hearing:
    """How receivers hear; powers in mW.

    Attributes:
        preamble_mw: the weakest signal that a receiver locks on to, and senses as a carrier.
        energy_mw: any power of at least this is sensed as a carrier.
        capture: how many times stronger a later signal has to be to take a receiver over; inf: never.
        interferes: whether frames of the same network disturb each other at all.
        cca_ns: how long a carrier is there before it is sensed; 802.11's aCCATime is at most 4 us with OFDM.
        channels: on which nodes listen and transmit; 0 unless given.
        adjacent: shares of power that receivers take in from signals on other channels.
    """

    preamble_mw: float = 1e-12
    energy_mw: float = 1e-12
    capture: float = inf
    interferes: bool = True
    cca_ns: int = 0
    channels: Mapping[int, int] = field(default_factory=lambda: MappingProxyType({}))
    adjacent: Leaks = field(default_factory=Leaks)

    def senses(self, power_mw: float) -> bool:
        """Whether a signal alone is sensed as a carrier."""
        return power_mw >= self.preamble_mw or power_mw >= self.energy_mw


class SharedAir(Protocol):
    """What receivers of one network are in together (`channel.access.air`)."""

    agenda: Agenda
    world: World
    hearing: Hearing
    on_fate: Callable[[AirFrame, int, Loss | None], object]

    def attend(self, receiver: Receiver) -> object:
        """A receiver's access acts on what it hears from now on."""

    def ignore(self, receiver: Receiver) -> object:
        """A receiver's access only takes note of what it hears from now on."""

    def tunes(self) -> object:
        """A receiver is about to turn to another channel."""


class Foreign(Protocol):
    """A signal of another network at a receiver."""

    def taken_mw(self, channel: int) -> float:
        """What a receiver on a channel takes in of it."""


class Ear(Protocol):
    """What a node's access does on what it hears."""

    def busy(self) -> object:
        """A carrier is there."""

    def idle(self, damaged: bool, since_ns: int) -> object:
        """No carrier is there since an instant; ``damaged``: what was heard last had errors."""

    def heard(self, frame: AirFrame) -> object:
        """A frame came through."""

    def is_done(self) -> bool:
        """Whether by now it has nothing left for which it would attend."""


class DeafEar:
    """The access of a node that acts on nothing that it hears."""

    def busy(self) -> None:
        """Nothing."""

    def idle(self, damaged: bool, since_ns: int) -> None:
        """Nothing."""

    def heard(self, frame: AirFrame) -> None:
        """Nothing: its fate says it."""

    def is_done(self) -> bool:
        """Always."""
        return True


class _Reception:
    __slots__ = ("alone", "frame", "interference_mw", "pieces", "power_mw", "since_ns")

    def __init__(self, frame: AirFrame, power_mw: float, interference_mw: float, now_ns: int) -> None:
        self.frame, self.power_mw, self.interference_mw = frame, power_mw, interference_mw
        self.since_ns = now_ns
        self.pieces: list[Piece] = []

    def change(self, interference_mw: float, now_ns: int) -> None:
        if now_ns > self.since_ns:
            self.pieces.append(Piece(now_ns - self.since_ns, self.interference_mw))
            self.since_ns = now_ns
        self.interference_mw = interference_mw


class Receiver:
    """What one node hears.

    While a node's access does not attend to what it hears, whole frames pass it (`channel.access.reception.passing`):
    what they left here is then made up for by `has_heard` and `has_met`.

    Attributes:
        transmits: whether it is on the air itself.
        is_busy: whether it senses a carrier.
        channel: where it listens.
        sources_mw: what it takes in of interferers and emitters, while its access attends: energy, and nothing else.
    """

    __slots__ = (
        "_air",
        "_damaged",
        "_ear",
        "_elsewhere",
        "_foreign",
        "_locked",
        "_lost",
        "_noticing",
        "_signals",
        "channel",
        "is_busy",
        "node",
        "sources_mw",
        "transmits",
    )

    def __init__(self, air: SharedAir, node: int, ear: Ear) -> None:
        self._air, self.node, self._ear = air, node, ear
        self._signals: dict[AirFrame, float] = {}
        self._lost: dict[AirFrame, Loss] = {}
        self._locked: _Reception | None = None
        self._elsewhere: dict[AirFrame, float] = {}
        """Signals on other channels."""
        self._foreign: list[Foreign] = []
        """Signals of other networks."""
        self._damaged = False
        self.sources_mw = 0.0
        self._noticing: Entry | None = None
        self.transmits = self.is_busy = False
        self.channel = air.hearing.channels.get(node, 0)

    def attend(self) -> None:
        """From now on its access acts on what it hears."""
        self._air.attend(self)

    def ignore(self) -> None:
        """From now on its access only takes note of what it hears, and no time is given to it."""
        self._air.ignore(self)

    def is_done(self) -> bool:
        """Whether its access has nothing left for which it would attend."""
        return self._ear.is_done()

    def has_heard(self, damaged: bool | None, idle_since_ns: int) -> None:
        """Frames have passed; the last one that it followed had errors or not; None: it followed none."""
        if damaged is not None:
            self._damaged = damaged
        self._ear.idle(self._damaged, idle_since_ns)

    def has_met(self, frame: AirFrame, power_mw: float, since_ns: int) -> None:
        """A signal is here, alone, that came a while ago, while nobody attended."""
        agenda, hearing = self._air.agenda, self._air.hearing
        self._signals[frame] = power_mw
        if power_mw < hearing.preamble_mw:
            self._lost[frame] = Loss.NOISE
        else:
            self._locked = _Reception(frame, power_mw, 0.0, since_ns)
        if hearing.senses(power_mw):
            noticed_ns = since_ns + hearing.cca_ns
            if noticed_ns < agenda.now_ns:
                self.is_busy = True
            else:
                self._noticing = agenda.at(noticed_ns, SIGNAL_STARTS, self.node, self._tell, True)

    def meets_sources(self, power_mw: float, since_ns: int) -> None:
        """Its access attends from now on to a power of sources that is there since an instant."""
        agenda, noticed_ns = self._air.agenda, since_ns + self._air.hearing.cca_ns
        self.sources_mw = power_mw
        if self.is_busy or not self._takes_enough():
            return
        if noticed_ns < agenda.now_ns:
            self.is_busy = True
        elif self._noticing is None:
            self._noticing = agenda.at(noticed_ns, SIGNAL_STARTS, self.node, self._tell, True)

    def hears_sources(self, power_mw: float) -> None:
        """Sources of interference have another power from now on."""
        self.sources_mw = power_mw
        self._sense()

    @property
    def follows(self) -> AirFrame | None:
        """The frame that it is locked on to."""
        return None if self._locked is None else self._locked.frame

    def tune(self, channel: int) -> None:
        """Listen on a channel from now on; what is under way there it has no preamble of, and does not lock on to."""
        if channel == self.channel:
            return
        self._air.tunes()
        self.channel = channel
        here = {**self._signals, **self._elsewhere}
        for frame in here:
            if self._lost.get(frame, Loss.COLLIDED) is Loss.COLLIDED:
                self._lost[frame] = Loss.NO_LOCK
        self._signals = {frame: power for frame, power in here.items() if frame.channel == channel}
        self._elsewhere = {frame: power for frame, power in here.items() if frame.channel != channel}
        self._locked = None
        self._damaged = False
        self._sense()

    def starts(self, frame: AirFrame, power_mw: float) -> None:
        """A signal arrives."""
        if frame.channel != self.channel:
            self._elsewhere[frame] = power_mw
            self._lost[frame] = Loss.HALF_DUPLEX if self.transmits else Loss.NO_LOCK
            self._leaks()
            return
        hearing, locked, signals = self._air.hearing, self._locked, self._signals
        now_ns = self._air.agenda.now_ns
        others_mw = self._heard_mw() if hearing.interferes else 0.0
        signals[frame] = power_mw
        if self.transmits:
            self._lost[frame] = Loss.HALF_DUPLEX
        elif power_mw < hearing.preamble_mw:
            self._lost[frame] = Loss.NOISE
            if locked is not None and hearing.interferes:
                locked.change(others_mw + power_mw - locked.power_mw, now_ns)
        elif locked is None:
            self._locked = _Reception(frame, power_mw, others_mw, now_ns)
        elif not hearing.interferes:
            self._lost[frame] = Loss.COLLIDED
        elif power_mw >= hearing.capture * locked.power_mw:
            self._lost[locked.frame] = Loss.COLLIDED
            self._locked = _Reception(frame, power_mw, others_mw, now_ns)
        else:
            self._lost[frame] = Loss.COLLIDED
            locked.change(others_mw + power_mw - locked.power_mw, now_ns)
        self._sense()

    def ends(self, frame: AirFrame) -> None:
        """A signal has passed."""
        air, locked = self._air, self._locked
        if frame.channel != self.channel:
            del self._elsewhere[frame]
            self._leaks()
            air.on_fate(frame, self.node, self._lost.pop(frame))
            return
        power_mw = self._signals.pop(frame)
        loss = self._lost.pop(frame, None)
        if loss is Loss.COLLIDED and not air.world.comes_alone(frame, self.node, power_mw):
            loss = Loss.NOISE
        if locked is not None:
            if locked.frame is frame:
                self._locked = None
                locked.change(0.0, air.agenda.now_ns)
                came, alone = air.world.survives(frame, self.node, locked.power_mw, locked.pieces)
                loss = None if came else Loss.COLLIDED if alone else Loss.NOISE
                self._damaged = not came
            elif air.hearing.interferes:
                locked.change(self._heard_mw(but=locked.frame), air.agenda.now_ns)
        air.on_fate(frame, self.node, loss)
        if loss is None:
            self._ear.heard(frame)
        self._sense()

    def _heard_mw(self, but: AirFrame | None = None) -> float:
        """The power of all signals but one, with what leaks in from other channels."""
        heard_mw = sum(power for frame, power in self._signals.items() if frame is not but)
        hearing = self._air.hearing
        if self._elsewhere and hearing.adjacent:
            for frame, power in self._elsewhere.items():
                channels = abs(frame.channel - self.channel)
                heard_mw += power * hearing.adjacent.share(frame.node, self.node, channels)
        return heard_mw

    def _leaks(self) -> None:
        """What is on other channels has changed."""
        hearing, locked = self._air.hearing, self._locked
        if not hearing.adjacent:
            return
        if locked is not None and hearing.interferes:
            locked.change(self._heard_mw(but=locked.frame), self._air.agenda.now_ns)
        self._sense()

    def foreign_starts(self, signal: Foreign) -> None:
        """A signal of another network arrives: energy, and nothing else; as noise the world counts it."""
        self._foreign.append(signal)
        self._sense()

    def foreign_ends(self, signal: Foreign) -> None:
        """A signal of another network has passed."""
        self._foreign.remove(signal)
        self._sense()

    def begins_to_transmit(self) -> None:
        """It is on the air from now on: what it was about to hear is lost."""
        self.transmits = True
        if self._locked is not None:
            self._lost[self._locked.frame] = Loss.HALF_DUPLEX
            self._locked = None
        for frame, loss in self._lost.items():
            if loss is Loss.COLLIDED:
                self._lost[frame] = Loss.HALF_DUPLEX
        self._damaged = False
        self._sense()

    def ends_to_transmit(self) -> None:
        """It hears again; signals that are under way it senses by their energy alone."""
        self.transmits = False
        self._sense()

    def _sense(self) -> None:
        is_busy = self.transmits or self._locked is not None or self._takes_enough()
        if is_busy != self.is_busy or self._noticing is not None:
            self._changes(is_busy)

    def _takes_enough(self) -> bool:
        """Whether all that it takes in together is a carrier."""
        is_quiet = not (self._signals or self._elsewhere or self._foreign or self.sources_mw)
        return not is_quiet and self.energy_mw() + self.sources_mw >= self._air.hearing.energy_mw

    def energy_mw(self) -> float:
        """The power of all signals that it takes in now, those of other networks too; sources are no signals."""
        heard_mw = self._heard_mw()
        if self._foreign:
            heard_mw += sum(signal.taken_mw(self.channel) for signal in self._foreign)
        return heard_mw

    def _changes(self, is_busy: bool) -> None:
        """A carrier of others is noticed when it has been there for a while, all else at once."""
        agenda, cca_ns = self._air.agenda, self._air.hearing.cca_ns
        if is_busy and cca_ns and not self.transmits:
            if self._noticing is None:
                self._noticing = agenda.at(agenda.now_ns + cca_ns, SIGNAL_STARTS, self.node, self._tell, True)
            return
        agenda.call_off(self._noticing)
        self._tell(is_busy)

    def _tell(self, is_busy: bool) -> None:
        self._noticing = None
        if is_busy != self.is_busy:
            self.is_busy = is_busy
            if is_busy:
                self._ear.busy()
            else:
                self._ear.idle(self._damaged, self._air.agenda.now_ns)
