"""One SiK radio: when it sends what, and what it makes of what it hears.

Source: ArduPilot/SiK, `Firmware/radio/tdm.c` (`tdm_serial_loop`, `link_update`), whose loop is here a chain of events:
each at the next tick at which something can change.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Final, NamedTuple, Protocol

from channel.access.agenda import ACTS, Agenda, Entry
from channel.access.air import Receiver
from channel.access.media.sik.stream import ByteStream, Cut
from channel.access.media.sik.tdm import OWN, Hopping, Tdm, TdmState, Trailer
from channel.access.media.sik.timing import (
    LBT_TICKS,
    LEAST_ROOM_BYTES,
    LINK_TICKS,
    STATISTICS_BYTES,
    SikSettings,
    SikTiming,
)
from channel.access.packets import AirFrame, AirPacket
from channel.access.words import WordStream

NEVER: Final = -1
LOOKS_TO_LOSE_LOCK: Final = 40
LOOKS_AT_START, LOOKS_AFTER_LOSS = 10, 5
NO_LIMIT_PERCENT: Final = 100


class Burst(NamedTuple):
    """What is in a frame: parts of packets, and the trailer."""

    parts: list[Cut]
    trailer: Trailer


class SikAir(Protocol):
    """The medium that SiK radios are on (`channel.access.media.sik.medium`)."""

    agenda: Agenda
    settings: SikSettings
    timing: SikTiming

    def next_packet(self, node: int) -> AirPacket | None:
        """The packet that leaves a node's queue now."""

    def first_packet(self, node: int) -> AirPacket | None:
        """The packet that would leave a node's queue next."""

    def transmit(self, radio: SikRadio, burst: Burst, frame: AirFrame) -> object:
        """Put a radio's packet on the air."""

    def samples_noise(self, node: int) -> object:
        """A radio that might transmit measures the noise."""

    def heard_nobody(self, node: int) -> object:
        """A radio has had no packet since it last looked."""


class SikRadio:
    """One node's radio.

    Args:
        medium: it is on.
        node: whose it is.
        others: the other radios of its NETID: it takes each for its peer.
        words: of its own draws.
        order: of its network's channels.
        phase: ticks since the start of its round at instant 0.
        hop: place in the order at which its latest own window was.
        sub_ns: how far into a tick it is at instant 0.

    Attributes:
        stream: of its host's bytes.
        hopping: where it sends and listens.
    """

    __slots__ = (
        "_agenda",
        "_average_duty",
        "_duty_wait",
        "_epoch_ns",
        "_first_look",
        "_frames",
        "_heard_since_look",
        "_looks_without",
        "_medium",
        "_notices_ns",
        "_others",
        "_pending",
        "_quiet_since",
        "_receiver",
        "_rests",
        "_sends_statistics",
        "_settings",
        "_tdm",
        "_tick",
        "_timing",
        "_transmits",
        "_transmitted",
        "_words",
        "hopping",
        "node",
        "stream",
    )

    def __init__(
        self,
        medium: SikAir,
        node: int,
        others: Collection[int],
        words: WordStream,
        order: tuple[int, ...],
        *,
        phase: int,
        hop: int,
        sub_ns: int,
    ) -> None:
        self._medium, self.node, self._others, self._words = medium, node, others, words
        self._agenda: Agenda = medium.agenda
        self._settings, self._timing = medium.settings, medium.timing
        self._epoch_ns, self._tick = -sub_ns, 0
        # Windows of two take turns: when each notices the other, or looks, makes no odds, and is as simple as may be.
        is_pair = len(others) == 1
        self._notices_ns = 0 if is_pair else self._timing.sync_ns
        self._first_look = LINK_TICKS if is_pair else LINK_TICKS - words.below(LINK_TICKS)
        self._tdm = Tdm(self._timing, phase, self._turned)
        self.hopping = Hopping(order, hop + (self._tdm.state is not OWN), locked=self._settings.locked)
        self.stream = ByteStream(
            lambda: medium.first_packet(node),
            lambda: medium.next_packet(node),
            self._timing.framed_bytes if self._settings.framing else 0,
        )
        self._receiver: Receiver
        self._pending: Entry | None = None
        self._frames = 0
        self._transmits = self._heard_since_look = self._sends_statistics = False
        self._looks_without = 0 if self._settings.locked else LOOKS_AT_START
        self._average_duty, self._transmitted, self._duty_wait = 0.0, 0, False
        self._quiet_since, self._rests = 0, 0

    def begin(self, receiver: Receiver) -> None:
        """Switch on, at instant 0."""
        self._receiver = receiver
        receiver.channel = self.hopping.listens_on
        tick = self._first_look
        self._agenda.at(self._instant_ns(tick), ACTS, self.node, self._look, tick)
        self._agenda.at(0, ACTS, self.node, self.wake)

    def until_window_ns(self) -> int:
        """Until its own window opens; 0: it is open."""
        ticks = self._tdm.until_own()
        if not ticks:
            return 0
        return max(self._instant_ns(self._tick + ticks) - self._agenda.now_ns, 0)

    # Time.

    def _instant_ns(self, tick: int) -> int:
        return self._epoch_ns + tick * self._settings.tick_ns

    def _catch_up(self) -> None:
        """Come to the present tick."""
        tick = (self._agenda.now_ns - self._epoch_ns) // self._settings.tick_ns
        passed, self._tick = tick - self._tick, tick
        self._tdm.advance(passed)

    def _turned(self, state: TdmState) -> None:
        """Another part of the round begins."""
        if state is OWN or state is TdmState.SILENCE1:
            self.hopping.hop()
            self._receiver.tune(self.hopping.listens_on)
            if self._settings.channels > 1:
                self._listens_anew()
        if state is OWN and self._settings.duty_cycle_percent != NO_LIMIT_PERCENT:
            share = 100.0 * self._transmitted / self._timing.round
            self._average_duty = 0.95 * self._average_duty + 0.05 * share
            self._transmitted = 0
            self._duty_wait = self._average_duty >= self._settings.duty_cycle_percent

    def _look(self, tick: int) -> None:
        """Twice a second: is the link alive?"""
        self._looks_without = 0 if self._heard_since_look else self._looks_without + 1
        self._heard_since_look, self._sends_statistics = False, True
        if self._looks_without:
            self._medium.heard_nobody(self.node)
        if self._looks_without > LOOKS_TO_LOSE_LOCK:
            self._looks_without = LOOKS_AFTER_LOSS
            if not self._transmits:
                self._catch_up()
            if self._words.below(2):
                self._shift()
            self.hopping.lost()
            self._receiver.tune(self.hopping.listens_on)
            self.wake()
        self._agenda.at(self._instant_ns(tick + LINK_TICKS), ACTS, self.node, self._look, tick + LINK_TICKS)

    def _shift(self) -> None:
        """Move the next window at random, so that two radios that send in step meet in the end."""
        tdm, timing = self._tdm, self._timing
        tdm.remaining = tdm.remaining - timing.latency if tdm.remaining > timing.silence else 1

    # Sending.

    def wake(self) -> None:
        """Something may be possible now: send, or plan the next look."""
        if self._transmits:
            return
        self._catch_up()
        self._agenda.call_off(self._pending)
        self._pending = None
        ticks = self._blocked()
        if ticks == 0 and (ticks := self._short_of_room()) == 0:
            self._send()
            return
        until = self._tdm.remaining if ticks == NEVER else min(ticks, self._tdm.remaining)
        at_ns = max(self._instant_ns(self._tick + until), self._agenda.now_ns)
        self._pending = self._agenda.at(at_ns, ACTS, self.node, self.wake)

    def _blocked(self) -> int:
        """Ticks before it may send, whatever it has; 0: it may; `NEVER`: not in this state."""
        tdm = self._tdm
        if self._settings.lbt:
            if self._receiver.is_busy:
                return NEVER
            ticks = self._quiet_since + LBT_TICKS + self._rests - self._tick
            if ticks > 0:
                return ticks
        if not tdm.may_send or tdm.yielded:
            return NEVER
        if tdm.wait:
            return tdm.wait
        if self._is_receiving():
            tdm.wait = self._timing.latency
            return tdm.wait
        self._medium.samples_noise(self.node)
        return NEVER if self._duty_wait else 0

    def _is_receiving(self) -> bool:
        """Whether a packet comes in; one of another network is dropped at its NETID, unless that is coded."""
        frame = self._receiver.follows
        if frame is None or self._agenda.now_ns < frame.started_ns + self._notices_ns:
            return False
        return self._settings.ecc or frame.node in self._others

    def _short_of_room(self) -> int:
        """Ticks before a packet fits in the window; 0: it does; `NEVER`: none does any more."""
        timing, remaining = self._timing, self._tdm.remaining
        fits = timing.fits_bytes(remaining, uint8_fault=self._settings.uint8_fault)
        if fits >= LEAST_ROOM_BYTES:
            return 0
        return (timing.pause(remaining) if self._settings.uint8_fault else 0) or NEVER

    def _send(self) -> None:
        """Put the next packet on the air: data, statistics, or an empty one that yields the window."""
        tdm, timing, settings = self._tdm, self._timing, self._settings
        fits = timing.fits_bytes(tdm.remaining, uint8_fault=settings.uint8_fault)
        room_bytes = timing.room_bytes(fits)
        parts = self.stream.cut(room_bytes, self._tick)
        data_bytes = sum(part.length_bytes for part in parts)
        is_statistics = (
            not parts and self._sends_statistics and tdm.state is OWN and room_bytes >= STATISTICS_BYTES
        )
        if is_statistics:
            data_bytes, self._sends_statistics = STATISTICS_BYTES, False
        elif not parts:
            tdm.yielded = True
        flight_ns = timing.frame_ns(data_bytes)
        left = tdm.remaining - (
            timing.flight(data_bytes) if settings.takes_estimate else -(-flight_ns // settings.tick_ns)
        )
        trailer = Trailer(0 if is_statistics else max(left, 1), tdm.state is not OWN, not data_bytes)
        self._transmitted += timing.flight(data_bytes)
        now_ns, number = self._agenda.now_ns, self._frames
        self._frames += 1
        self._transmits = True
        frame = AirFrame(
            self.node,
            number,
            "statistics" if is_statistics else "data" if parts else "yield",
            timing.fragile_bytes(data_bytes),
            now_ns,
            now_ns + flight_ns,
            channel=self.hopping.sends_on,
        )
        self._medium.transmit(self, Burst(parts, trailer), frame)

    def sent(self) -> None:
        """Its packet has left: pause, and go on."""
        self._transmits = False
        self._catch_up()
        self._tdm.wait = self._timing.latency
        self._listens_anew()
        self.wake()

    def _listens_anew(self) -> None:
        """What was listened before does not count any more."""
        self._quiet_since, self._rests = self._tick, 0

    # Hearing.

    def heard_peer(self, trailer: Trailer) -> None:
        """A packet of its NETID came: whoever sent it is the peer."""
        self._catch_up()
        self._heard_since_look = True
        self.hopping.found()
        self._tdm.heard(trailer)
        self._wake_soon()

    def _wake_soon(self) -> None:
        self._agenda.at(self._agenda.now_ns, ACTS, self.node, self.wake)

    # What its receiver hears (`channel.access.air.Ear`).

    def busy(self) -> None:
        """A carrier: what was listened before does not count."""
        if self._settings.lbt and not self._rests:
            self._rests = self._words.below(LBT_TICKS)

    def idle(self, damaged: bool, since_ns: int) -> None:
        """The channel is free from now on, whatever was on it."""
        del damaged, since_ns
        if self._settings.lbt:
            self._quiet_since = (self._agenda.now_ns - self._epoch_ns) // self._settings.tick_ns
            self._wake_soon()

    def is_done(self) -> bool:
        """Never: it follows its peers."""
        return False

    def heard(self, frame: AirFrame) -> None:
        """The medium says it to radios of its NETID alone; others drop the packet."""
