"""SiK telemetry radios (3DR, Holybro, RFD900): pairs that share the time in windows, hopping over channels.

Source: ArduPilot/SiK 2.2, `Firmware/radio/tdm.c`, `packet.c`, `freq_hopping.c`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from channel.access.agenda import ACTS
from channel.access.air import Air, DeafEar, Ear, Hearing
from channel.access.media.medium import AccessMedium
from channel.access.media.sik_radio import Burst, SikRadio
from channel.access.media.sik_timing import (
    NOMINAL_TICK_NS,
    REAL_TICK_NS,
    SikTiming,
    hop_order,
    sik_timing,
)
from channel.access.packets import AirPacket, Loss
from channel.access.queue import QueueLimits
from channel.access.words import WordStream
from channel.access.world import AirFrame, World
from channel.draws import Draws

HOST_BUFFER = QueueLimits(0, 1850)
"""Bytes from the host that wait in a radio (Si1000)."""
MAX_CHANNELS = 50


@dataclass(frozen=True, slots=True)
class SikSettings:
    """Of all radios, by the names of their parameters; defaults are the firmware's.

    Attributes:
        air_kbps: AIR_SPEED.
        ecc: ECC: Golay(23,12).
        framing: MAVLINK = 1: packets up to 237 B (less at low rates and with ECC) stay whole; else they are a stream.
        max_window_ms: MAX_WINDOW.
        duty_cycle_percent: DUTY_CYCLE; 100: no limit.
        lbt: LBT_RSSI: whether radios listen before they talk.
        channels: NUM_CHANNELS: 50 at 915 MHz, 10 at 433 and 868.
        uint8_fault: whether the bytes that fit are reckoned modulo 256, as the firmware does.
        tick_ns: how long a tick is: `REAL_TICK_NS`, or `NOMINAL_TICK_NS`, by which the firmware reckons.
        takes_estimate: whether a receiver takes the window in a trailer as it is, which the sender has shortened by too
            long an estimate of the packet's flight, so that windows open early; else what the sender really has left.
        locked: whether the radios of a pair have found each other before instant 0.
        pairs: who talks to whom; None: the nodes in their order, two by two.
        netids: of the pairs; None: 25 (the default of the firmware), 26 and so on.
        phases: (node, ticks since the start of its round at instant 0); others are drawn. The second of a locked pair
            follows the first.
    """

    air_kbps: int = 64
    ecc: bool = False
    framing: bool = True
    max_window_ms: int = 131
    duty_cycle_percent: int = 100
    lbt: bool = False
    channels: int = 50
    uint8_fault: bool = True
    tick_ns: int = REAL_TICK_NS
    takes_estimate: bool = False
    locked: bool = True
    pairs: tuple[tuple[int, int], ...] | None = None
    netids: tuple[int, ...] | None = None
    phases: tuple[tuple[int, int], ...] = ()

    def __post_init__(self) -> None:
        if not 1 <= self.channels <= MAX_CHANNELS:
            raise ValueError(f"{self.channels} channels: 1 to {MAX_CHANNELS}")
        if not 0 <= self.duty_cycle_percent <= 100:
            raise ValueError(f"a duty cycle of {self.duty_cycle_percent} %: 0 to 100")
        if not REAL_TICK_NS <= self.tick_ns <= NOMINAL_TICK_NS:
            raise ValueError(
                f"a tick of {self.tick_ns} ns: {REAL_TICK_NS} (real) to {NOMINAL_TICK_NS} (nominal)"
            )

    def timing(self) -> SikTiming:
        """In ticks."""
        return sik_timing(self.air_kbps, ecc=self.ecc, max_window_ms=self.max_window_ms, lbt=self.lbt)


class Sik(AccessMedium):
    """Pairs of SiK radios; what is for all goes to the peer.

    Args:
        world: nodes, powers, delays; a frame's length is what errors can hit, before it is coded.
        settings: of the radios.
        seed: of phases, and of what radios do at random.
        limits: of queues.
        hearing: how receivers hear; radios that listen before they talk sense its `energy_mw`.

    Raises:
        ValueError: pairs that do not fit the nodes, or settings that radios do not have.
    """

    air: Air

    def __init__(
        self,
        world: World,
        settings: SikSettings | None = None,
        *,
        seed: int = 1,
        limits: QueueLimits = HOST_BUFFER,
        hearing: Hearing | None = None,
    ) -> None:
        super().__init__(world, limits, limits.length_bytes or 1 << 31)
        self._draws = Draws(seed)
        self.settings = settings or SikSettings()
        self.timing = self.settings.timing()
        self.air = Air(self.agenda, world, hearing or Hearing(), self._passed)
        self._peers: dict[int, int] = {}
        self._radios: dict[int, SikRadio] = {}
        self._bursts: dict[AirFrame, Burst] = {}
        pairs, netids = self._networks()
        for pair, netid in zip(pairs, netids, strict=True):
            self._pair(pair, netid)
        ears: dict[int, Ear] = {node: self._radios.get(node, DeafEar()) for node in sorted(world.nodes)}
        for node, receiver in self.air.join(ears).items():
            if node in self._radios:
                self._radios[node].begin(receiver)

    def receivers_of(self, packet: AirPacket) -> tuple[int, ...]:
        """The node that it is for; if it is for several, the peer, if that is one of them."""
        if packet.to is not None:
            return (packet.to,)
        peer = self._peers.get(packet.node)
        return () if peer is None or not packet.is_for(peer) else (peer,)

    def until_window_ns(self, node: int) -> int:
        """How long until a node's own window opens, at the instant that `run` came to; 0: it is open."""
        return self._radios[node].until_window_ns()

    def is_locked(self, node: int) -> bool:
        """Whether a node's radio has found its peer."""
        return self._radios[node].hopping.locked

    def transmit(self, radio: SikRadio, burst: Burst, frame: AirFrame) -> None:
        """Put a radio's packet on the air."""
        self._bursts[frame] = burst
        self.air.transmit(frame, partial(self._free, radio))

    def _free(self, radio: SikRadio) -> None:
        """The transmitter is free as soon as the receiver has taken notice."""
        self.agenda.at(self.agenda.now_ns, ACTS, radio.node, radio.sent)

    def next_packet(self, node: int) -> AirPacket | None:
        """The packet that leaves a node's queue now."""
        return self._next(node)

    def first_packet(self, node: int) -> AirPacket | None:
        """The packet that would leave a node's queue next."""
        return self._first(node)

    def _networks(self) -> tuple[Sequence[tuple[int, int]], Sequence[int]]:
        nodes = sorted(self.world.nodes)
        pairs = self.settings.pairs
        if pairs is None:
            pairs = tuple(zip(nodes[::2], nodes[1::2], strict=False))
        members = [node for pair in pairs for node in pair]
        if len(set(members)) < len(members) or not set(members) <= set(nodes):
            raise ValueError(f"pairs {pairs}: each of the nodes {nodes} at most once, and no others")
        netids = self.settings.netids or tuple(range(25, 25 + len(pairs)))
        if len(netids) != len(pairs):
            raise ValueError(f"{len(netids)} NETIDs for {len(pairs)} pairs")
        if len(set(netids)) < len(netids):
            raise ValueError(f"NETIDs {netids}: one of its own for each pair")
        return pairs, netids

    def _pair(self, pair: tuple[int, int], netid: int) -> None:
        """Both radios of a network; locked ones are half a round apart, on the same channel in their windows."""
        first, second = pair
        order, timing, set_to = (
            hop_order(netid, self.settings.channels),
            self.timing,
            dict(self.settings.phases),
        )
        self._peers[first], self._peers[second] = second, first
        radios = []
        for node in pair:
            words = WordStream(self._draws, str(node), "sik")
            phase, hop, sub_ns = (words.below(n) for n in (timing.round, len(order), self.settings.tick_ns))
            radios.append((words, set_to.get(node, phase) % timing.round, hop, sub_ns))
        if self.settings.locked:
            _, phase, hop, sub_ns = radios[0]
            phase = (phase + timing.round // 2) % timing.round
            is_ahead = phase < timing.round // 2
            radios[1] = (radios[1][0], phase, hop + (1 if is_ahead else -1), sub_ns)
        for node, (words, phase, hop, sub_ns) in zip(pair, radios, strict=True):
            self._radios[node] = SikRadio(
                self, node, self._peers[node], words, order, phase=phase, hop=hop, sub_ns=sub_ns
            )

    def _wake(self, node: int) -> None:
        self._radios[node].wake()

    def _enter(self, packet: AirPacket) -> None:
        peer = self._peers.get(packet.node)
        if packet.to is not None and packet.to != peer:
            self._lost(packet, Loss.NO_PEER)
        elif peer is not None:
            super()._enter(packet)

    def _beside_bytes(self, node: int) -> int:
        return self._radios[node].stream.begun_bytes

    def _passed(self, frame: AirFrame, receiver: int, loss: Loss | None) -> None:
        """A frame has passed a node."""
        if receiver != self._peers.get(frame.node):
            return
        burst = self._bursts.pop(frame)
        if loss is None:
            self._radios[receiver].heard_peer(burst.trailer)
        for passage, length_bytes in burst.parts:
            passage.missing_bytes -= length_bytes
            if not passage.is_lost and (loss is not None or not passage.missing_bytes):
                passage.is_lost = loss is not None
                self._book(passage.packet, receiver, frame, passage.frames, loss)
