"""IEEE 802.11 DCF: carrier sense, back-off that freezes and resumes, acknowledged unicast, broadcast without.

IEEE 802.11-2020, 10.3. A station may transmit when the medium was idle for DIFS (EIFS after a frame with errors) and
its back-off counter is 0; the counter falls by one per idle slot, and stands while the medium is busy. After each
transmission it is drawn anew from 0 to CW; CW doubles with each failed attempt of a unicast.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

from channel.access.agenda import ACTS, Agenda, Entry
from channel.access.air import Air, Hearing, Receiver
from channel.access.media.forecast import Forecast
from channel.access.media.medium import AccessMedium
from channel.access.packets import AirFrame, AirPacket, Loss, Reply
from channel.access.queue import QueueLimits, expires_ns
from channel.access.timing import ACK_BYTES, CTS_BYTES, RTS_BYTES, Wifi
from channel.access.words import WordStream
from channel.access.world import Foreseeing, World
from channel.draws import Draws

DATA, ACK, RTS, CTS = "data", "ack", "rts", "cts"
LENGTHS = {ACK: ACK_BYTES, RTS: RTS_BYTES, CTS: CTS_BYTES}
NO_BACKOFF: Final = -1


@dataclass(frozen=True, slots=True)
class DcfSettings:
    """Of all stations of a network.

    Attributes:
        attempts_max: of a unicast, then it is given up; dot11ShortRetryLimit is 7.
        rts_from_bytes: unicasts of at least this length are announced by RTS; None: none.
        uses_eifs: whether stations wait EIFS, not DIFS, after a frame with errors; Bianchi's formula has both.
        reach_ns: the longest way, there and back, that an answer is waited for beyond its own length; 802.11's coverage
            classes add up to 93 us.
        header_bytes: of the layers above, as IP and UDP, within the MAC's frame of each packet that comes from there.
    """

    attempts_max: int = 7
    rts_from_bytes: int | None = None
    uses_eifs: bool = True
    reach_ns: int = 0
    header_bytes: int = 0

    def __post_init__(self) -> None:
        if self.attempts_max < 1:
            raise ValueError(f"attempts_max = {self.attempts_max}: at least 1")


class Csma(AccessMedium):
    """A network of 802.11 stations (IBSS: no access point, no association).

    Args:
        world: nodes, powers, delays.
        timing: of frames, slots and windows.
        seed: of the back-off.
        settings: of the stations.
        limits: of queues.
        hearing: how receivers hear.
    """

    air: Air

    def __init__(
        self,
        world: World,
        timing: Wifi,
        *,
        seed: int = 1,
        settings: DcfSettings | None = None,
        limits: QueueLimits | None = None,
        hearing: Hearing | None = None,
    ) -> None:
        self.timing, self.settings = timing, settings or DcfSettings()
        longest_bytes = timing.max_length_bytes - self.settings.header_bytes
        super().__init__(world, limits or QueueLimits(), longest_bytes)
        hearing = hearing or Hearing()
        self.air = Air(self.agenda, world, hearing, self._passed, self._book_all, senses_sources=True)
        draws = Draws(seed)
        self._stations = {
            node: Station(self, node, WordStream(draws, self.ids[node], "backoff"))
            for node in sorted(world.nodes)
        }
        for node, receiver in self.air.join(self._stations).items():
            self._stations[node].receiver = receiver
            receiver.ignore()

    def expired(self, packet: AirPacket) -> None:
        """A packet waited longer than its life time for the medium."""
        self._lost(packet, Loss.EXPIRED)

    def next_packet(self, node: int) -> AirPacket | None:
        """What a station sends next."""
        return self._next(node)

    def body_bytes(self, packet: AirPacket) -> int:
        """What the MAC carries of a packet: its length and the headers of the layers above."""
        return packet.length_bytes + (self.settings.header_bytes if packet.is_from_above else 0)

    def received(self, frame: AirFrame, packet: AirPacket, attempts: int) -> None:
        """A unicast came to its node, for the first time."""
        assert packet.to is not None
        self._book(packet, packet.to, frame, attempts, None)

    def ended(
        self, packet: AirPacket, frame: AirFrame | None, attempts: int, loss: Loss | None = None
    ) -> None:
        """The sender of a unicast has done with it, None: it is acknowledged; it may have come though it is not."""
        assert packet.to is not None
        if self._stations[packet.to].misses(packet):
            self._book(packet, packet.to, frame, attempts, loss)
        self._tell(Reply(packet, self.agenda.now_ns, loss is None, attempts))

    def silenced(self, packet: AirPacket, frame: AirFrame | None, attempts: int) -> None:
        """The sender's radio is off: a packet goes no further."""
        if packet.to is None:
            self._lost(packet, Loss.RADIO_OFF)
        else:
            self.ended(packet, frame, attempts, Loss.RADIO_OFF)

    def attempts(self, node: int) -> int:
        """How often a station's present packet was on the air."""
        return self._stations[node].attempts

    def _foresee(self, world: Foreseeing, entering: Sequence[AirPacket]) -> None:
        """The next broadcast of each station that has none under way."""
        first = {packet.node: packet for packet in sorted(entering, key=lambda packet: -packet.at_ns)}
        stations, cca_ns = self._stations, self.air.hearing.cca_ns
        frames = [stations[node].foreseen(packet) for node, packet in first.items() if packet.to is None]
        if len(frames) > 1:
            delays_ns = world.delays_ns(frames)
            forecast = Forecast(
                frames, delays_ns, self.timing, cca_ns, lambda node: stations[node].foreseen_backoff()
            )
            world.expect(forecast.frames())

    def _wake(self, node: int) -> None:
        self._stations[node].wake()

    def _passed(self, frame: AirFrame, receiver: int, loss: Loss | None) -> None:
        packet = frame.packet
        if packet is not None and packet.to is None:
            self._book(packet, receiver, frame, 1, loss)


class Station:
    """One node's DCF.

    Attributes:
        attempts: how often its present packet was on the air; an RTS that nobody answered is none.
        receiver: of its node.
    """

    __slots__ = (
        "_agenda",
        "_backoff",
        "_cw",
        "_difs_ns",
        "_exchanging",
        "_frame",
        "_frames",
        "_heard_from",
        "_idle_since_ns",
        "_ifs_ns",
        "_immediate_ns",
        "_medium",
        "_nav_ns",
        "_node",
        "_packet",
        "_pending",
        "_reach_ns",
        "_timeout",
        "_timing",
        "_tried_ns",
        "_tries",
        "_words",
        "attempts",
        "receiver",
    )

    def __init__(self, medium: Csma, node: int, words: WordStream) -> None:
        self._medium, self._node, self._words = medium, node, words
        self._agenda: Agenda = medium.agenda
        self._timing = timing = medium.timing
        self._reach_ns = medium.settings.reach_ns
        self.receiver: Receiver
        self._packet: AirPacket | None = None
        self._frame: AirFrame | None = None
        self.attempts = self._tries = self._tried_ns = 0
        self._cw, self._backoff = timing.cw_min, NO_BACKOFF
        self._idle_since_ns, self._ifs_ns, self._nav_ns = -timing.eifs_ns, timing.difs_ns, 0
        self._difs_ns, self._immediate_ns = timing.difs_ns, 0
        self._pending: Entry | None = None
        self._timeout: Entry | None = None
        self._frames = 0
        self._exchanging = False
        self._heard_from: dict[int, int] = {}

    # Access.

    def wake(self) -> None:
        """A packet waits, perhaps the first: if the medium is idle, and stays so for DIFS, it needs no back-off."""
        self.receiver.attend()
        if self._packet is None and self._take() and self._has_counted_down():
            now_ns = self._agenda.now_ns
            if self.receiver.is_busy or now_ns < self._nav_ns:
                self._draw_backoff()
            else:
                self._backoff, self._immediate_ns = NO_BACKOFF, now_ns + self._difs_ns
        self._schedule()

    def foreseen(self, packet: AirPacket) -> AirFrame:
        """A broadcast's frame, if nothing is in its way."""
        timing, at_ns = self._timing, packet.at_ns + self._difs_ns
        body_bytes = self._medium.body_bytes(packet)
        length_bytes, ended_ns = body_bytes + timing.header_bytes, at_ns + timing.broadcast_ns(body_bytes)
        return AirFrame(self._node, self._frames, DATA, length_bytes, at_ns, ended_ns, packet)

    def foreseen_backoff(self) -> int:
        """What it will draw next, slots."""
        return self._words.coming_below(self._cw + 1)

    def _has_counted_down(self) -> bool:
        """Whether no back-off is left of the last transmission."""
        ends_ns = self._counts_from_ns() + self._backoff * self._timing.slot_ns
        return self._backoff == NO_BACKOFF or (not self.receiver.is_busy and ends_ns <= self._agenda.now_ns)

    def has_had(self, packet: AirPacket) -> bool:
        """Whether the latest unicast that came from its sender is this one."""
        return self._heard_from.get(packet.node) == packet.number

    def misses(self, packet: AirPacket) -> bool:
        """Its sender has given it up: returns whether it had not come; what is still on its way is too late."""
        had = self.has_had(packet)
        self._heard_from[packet.node] = packet.number
        return not had

    def _take(self) -> bool:
        self._packet, self._frame = self._medium.next_packet(self._node), None
        self.attempts = self._tries = 0
        return self._packet is not None

    def _counts_from_ns(self) -> int:
        """From when on idle slots count, if the medium stays idle; EIFS takes no notice of the NAV (10.3.2.3.7)."""
        idle_ns, nav_ns = self._idle_since_ns + self._ifs_ns, self._nav_ns + self._difs_ns
        return idle_ns if idle_ns > nav_ns else nav_ns

    def _schedule(self) -> None:
        """Plan the next transmission, if there is something to send and the medium is idle."""
        if self._packet is None or self._exchanging or self._pending is not None or self.receiver.is_busy:
            return
        slots = self._backoff if self._backoff > 0 else 0
        at_ns = max(
            self._counts_from_ns() + slots * self._timing.slot_ns, self._immediate_ns, self._agenda.now_ns
        )
        self._pending = self._agenda.at(at_ns, ACTS, self._node, self._access)

    def _draw_backoff(self) -> None:
        self._backoff = self._words.below(self._cw + 1)

    def _access(self) -> None:
        """It may transmit."""
        self._pending = None
        packet, self._tried_ns = self._packet, self._agenda.now_ns
        assert packet is not None
        if self._medium.is_off(self._node, self._tried_ns):
            self._medium.silenced(packet, self._frame, self.attempts)
            self._cw, self._backoff = self._timing.cw_min, NO_BACKOFF
            self._take()
            self._schedule()
            return
        self._backoff = NO_BACKOFF
        if not self._tries and expires_ns(packet) < self._tried_ns - self._difs_ns:
            self._medium.expired(packet)
            if not self._take():
                return
            packet = self._packet
            assert packet is not None
        self._exchanging = True
        self._tries += 1
        if packet.to is None:
            duration_ns = self._timing.broadcast_ns(self._medium.body_bytes(packet))
            self._transmit(DATA, duration_ns, self._done, packet=packet)
        elif self._is_announced(packet):
            timing = self._timing
            rest_ns = timing.control_ns(CTS_BYTES) + timing.duration_ns(self._medium.body_bytes(packet))
            reserved_ns = 3 * timing.sifs_ns + rest_ns + timing.control_ns(ACK_BYTES)
            await_cts = partial(self._await, timing.control_ns(CTS_BYTES))
            self._transmit(
                RTS, timing.control_ns(RTS_BYTES), await_cts, to=packet.to, reserved_ns=reserved_ns
            )
        else:
            self._send_unicast(packet)

    def _is_announced(self, packet: AirPacket) -> bool:
        limit = self._medium.settings.rts_from_bytes
        return limit is not None and packet.length_bytes >= limit

    def _send_unicast(self, packet: AirPacket) -> None:
        timing = self._timing
        ack_ns = timing.control_ns(ACK_BYTES)
        self._transmit(
            DATA,
            timing.duration_ns(self._medium.body_bytes(packet)),
            partial(self._await, ack_ns),
            packet=packet,
            reserved_ns=timing.sifs_ns + ack_ns,
        )

    def _transmit(
        self,
        kind: str,
        duration_ns: int,
        then: Callable[[], object],
        *,
        packet: AirPacket | None = None,
        to: int | None = None,
        reserved_ns: int = 0,
    ) -> None:
        now_ns, number = self._agenda.now_ns, self._frames
        self._frames += 1
        self.attempts += packet is not None
        header_bytes = self._timing.header_bytes
        length_bytes = LENGTHS[kind] if packet is None else self._medium.body_bytes(packet) + header_bytes
        ended_ns = now_ns + duration_ns
        frame = AirFrame(
            self._node,
            number,
            kind,
            length_bytes,
            now_ns,
            ended_ns,
            packet,
            to,
            reserved_ns,
            self._tries if packet is None else self.attempts,
            self.receiver.channel,
        )
        if packet is not None:
            self._frame = frame
        self._medium.air.transmit(frame, then)

    # After its own transmission.

    def _done(self) -> None:
        """The packet is dealt with: back off, and take the next."""
        self._exchanging = False
        self._cw = self._timing.cw_min
        self._draw_backoff()
        self._take()

    def _await(self, reply_ns: int) -> None:
        """An answer has to be here one slot after it could be, at the latest."""
        timing = self._timing
        at_ns = self._agenda.now_ns + timing.sifs_ns + reply_ns + timing.slot_ns + self._reach_ns
        self._timeout = self._agenda.at(at_ns, ACTS, self._node, self._failed)

    def _failed(self) -> None:
        """No answer came; the wait for it is not counted as idle slots."""
        self._timeout, self._exchanging = None, False
        waited_ns = self._timing.slot_ns + self._reach_ns
        self._idle_since_ns = max(self._idle_since_ns, self._agenda.now_ns - waited_ns)
        packet = self._packet
        assert packet is not None
        if self._tries >= self._medium.settings.attempts_max:
            assert packet.to is not None
            self._medium.ended(packet, self._frame, self.attempts, self._why_unanswered(packet.to))
            self._done()
        else:
            self._cw = min(2 * self._cw + 1, self._timing.cw_max)
            self._draw_backoff()
        self._schedule()

    def _why_unanswered(self, to: int) -> Loss:
        if self._medium.is_off(to, self._tried_ns):
            return Loss.RADIO_OFF
        return Loss.PARTITIONED if self._medium.are_apart(self._node, to, self._tried_ns) else Loss.RETRIES

    # What it hears (`channel.access.air.Ear`).

    def busy(self) -> None:
        """The medium is busy: what was planned has to wait; nobody attends without a packet or a back-off."""
        pending, self._pending = self._pending, None
        self._agenda.call_off(pending)
        if self._backoff != NO_BACKOFF:
            self._count_down()
        elif pending is not None:
            self._draw_backoff()
        if self._backoff == NO_BACKOFF and self._packet is None:
            self.receiver.ignore()

    def is_done(self) -> bool:
        """Whether its back-off has run out while there is nothing to send."""
        if self._packet is not None or not self._has_counted_down():
            return False
        self._backoff = NO_BACKOFF
        return True

    def _count_down(self) -> None:
        """Take off the back-off the slots that were idle until now."""
        passed = (self._agenda.now_ns - self._counts_from_ns()) // self._timing.slot_ns
        if passed > 0:
            self._backoff = max(self._backoff - passed, 0)
        if passed >= 0 and self._backoff == 0 and self._packet is None:
            self._backoff = NO_BACKOFF  # it ran out while there was nothing to send

    def idle(self, damaged: bool, since_ns: int) -> None:
        """The medium is idle, since an instant."""
        timing = self._timing
        self._idle_since_ns = since_ns
        self._ifs_ns = timing.eifs_ns if damaged and self._medium.settings.uses_eifs else self._difs_ns
        self._schedule()

    def heard(self, frame: AirFrame) -> None:
        """A frame came through."""
        packet = frame.packet
        if packet is not None and packet.to == self._node:
            self._answer(ACK, frame)
            if not self.has_had(packet):
                self._heard_from[packet.node] = packet.number
                self._medium.received(frame, packet, self._medium.attempts(packet.node))
        elif frame.to == self._node:
            self._heard_control(frame)
        elif frame.reserved_ns:
            self._nav_ns = max(self._nav_ns, self._agenda.now_ns + frame.reserved_ns)

    def _heard_control(self, frame: AirFrame) -> None:
        if frame.kind == RTS:
            if self._nav_ns <= self._agenda.now_ns:
                self._answer(CTS, frame)
        elif self._timeout is not None:
            packet = self._packet
            assert packet is not None
            if frame.node != packet.to:
                return  # the late answer of another
            self._agenda.call_off(self._timeout)
            self._timeout = None
            if frame.kind == CTS:
                at_ns = self._agenda.now_ns + self._timing.sifs_ns
                self._agenda.at(at_ns, ACTS, self._node, self._send_unicast, packet)
            else:
                self._medium.ended(packet, self._frame, self.attempts)
                self._done()

    def _answer(self, kind: str, frame: AirFrame) -> None:
        """Answer after SIFS, whatever the medium is like."""
        timing = self._timing
        duration_ns = timing.control_ns(LENGTHS[kind])
        reserved_ns = max(0, frame.reserved_ns - timing.sifs_ns - duration_ns)
        at_ns = self._agenda.now_ns + timing.sifs_ns
        self._agenda.at(at_ns, ACTS, self._node, self._reply, kind, duration_ns, frame.node, reserved_ns)

    def _reply(self, kind: str, duration_ns: int, to: int, reserved_ns: int) -> None:
        if not self.receiver.transmits and not self._medium.is_off(self._node, self._agenda.now_ns):
            self._transmit(kind, duration_ns, _nothing, to=to, reserved_ns=reserved_ns)


def _nothing() -> None:
    """An answer is not answered."""
