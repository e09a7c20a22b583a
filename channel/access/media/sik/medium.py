"""SiK telemetry radios (3DR, Holybro, RFD900): two that share the time in windows, hopping over channels.

More than two may have one NETID, for which the firmware is not made: each takes any packet of its NETID as its peer's,
so those that have heard the same one have their windows at the same time, and disturb each other in them.

Source: ArduPilot/SiK 2.2, `Firmware/radio/tdm.c`, `packet.c`, `freq_hopping.c`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from channel.access.agenda import ACTS
from channel.access.air import Air, DeafEar, Ear, Hearing
from channel.access.media.medium import AccessMedium
from channel.access.media.sik.radio import Burst, SikRadio
from channel.access.media.sik.timing import SikSettings, hop_order
from channel.access.packets import AirFrame, AirPacket, Loss
from channel.access.queue import QueueLimits
from channel.access.words import WordStream
from channel.access.world import Metering, World
from channel.draws import Draws

HOST_BUFFER = QueueLimits(0, 1850)
"""Bytes from the host that wait in a radio (Si1000)."""
DEFAULT_NETID = 25
LEAST_RADIOS = 2
"""That can talk to each other."""
UNLIMITED_BYTES = 1 << 31
"""Longer than any packet."""


class Sik(AccessMedium):
    """SiK radios of one or several NETIDs; what is for all goes to all others of the sender's NETID.

    Args:
        world: nodes, powers, delays; a frame's length is what errors can hit, before it is coded.
        settings: of the radios.
        seed: of phases, and of what radios do at random.
        limits: of queues.
        hearing: how receivers hear; radios that listen before they talk sense its `energy_mw`.

    Raises:
        ValueError: networks that do not fit the nodes, or settings that radios do not have.
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
        super().__init__(world, limits, limits.length_bytes or UNLIMITED_BYTES)
        self._draws = Draws(seed)
        self._meter = world if isinstance(world, Metering) else None
        self.settings = settings or SikSettings()
        self.timing = self.settings.timing()
        senses = self.settings.lbt
        self.air = Air(self.agenda, world, hearing or Hearing(), self._passed, senses_sources=senses)
        self._others: dict[int, tuple[int, ...]] = {}
        """Of each node on a NETID: the other nodes on it."""
        self._radios: dict[int, SikRadio] = {}
        self._bursts: dict[AirFrame, tuple[Burst, set[int]]] = {}
        """What is on the air, and whom of the sender's NETID it has not passed."""
        for netid, nodes in self._networks().items():
            self._join(nodes, netid)
        ears: dict[int, Ear] = {node: self._radios.get(node, DeafEar()) for node in sorted(world.nodes)}
        for node, receiver in self.air.join(ears).items():
            if node in self._radios:
                self._radios[node].begin(receiver)

    def receivers_of(self, packet: AirPacket) -> tuple[int, ...]:
        """The node that it is for; if it is for several, those of them that have the sender's NETID."""
        if packet.to is not None:
            return (packet.to,)
        return tuple(node for node in self._others.get(packet.node, ()) if packet.is_for(node))

    def until_window_ns(self, node: int) -> int:
        """How long until a node's own window opens, at the instant that `run` came to; 0: it is open."""
        return self._radios[node].until_window_ns()

    def is_locked(self, node: int) -> bool:
        """Whether a node's radio has found another of its NETID."""
        return self._radios[node].hopping.locked

    def transmit(self, radio: SikRadio, burst: Burst, frame: AirFrame) -> None:
        """Put a radio's packet on the air."""
        self._bursts[frame] = burst, set(self._others[frame.node])
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

    def samples_noise(self, node: int) -> None:
        """A radio that might transmit measures the noise, as the firmware does before each packet."""
        if self._meter is not None:
            self._meter.samples_noise(node, self.agenda.now_ns, self.air.receiver(node).energy_mw())

    def heard_nobody(self, node: int) -> None:
        """A radio has had no packet since it last looked."""
        if self._meter is not None:
            self._meter.heard_nobody(node)

    def _networks(self) -> dict[int, Sequence[int]]:
        """The nodes of each NETID."""
        nodes = sorted(self.world.nodes)
        networks = self.settings.networks
        if networks is None:
            networks = tuple(zip(nodes[::2], nodes[1::2], strict=False))
        members = [node for network in networks for node in network]
        if len(set(members)) < len(members) or not set(members) <= set(nodes):
            raise ValueError(f"networks {networks}: each of the nodes {nodes} at most once, and no others")
        if any(len(network) < LEAST_RADIOS for network in networks):
            raise ValueError(f"networks {networks}: {LEAST_RADIOS} or more nodes in each")
        netids = self.settings.netids or tuple(range(DEFAULT_NETID, DEFAULT_NETID + len(networks)))
        if len(netids) != len(networks):
            raise ValueError(f"{len(netids)} NETIDs for {len(networks)} networks")
        if len(set(netids)) < len(netids):
            raise ValueError(f"NETIDs {netids}: one of its own for each network")
        return dict(zip(netids, networks, strict=True))

    def _join(self, nodes: Sequence[int], netid: int) -> None:
        """All radios of a NETID; locked ones are half a round behind the first, on its channel in its window."""
        order, timing, set_to = (
            hop_order(netid, self.settings.channels),
            self.timing,
            dict(self.settings.phases),
        )
        first: tuple[int, int, int] | None = None
        for node in nodes:
            words = WordStream(self._draws, self.ids[node], "sik")
            phase, hop, sub_ns = (words.below(n) for n in (timing.round, len(order), self.settings.tick_ns))
            phase = set_to.get(node, phase) % timing.round
            if first is None:
                first = phase, hop, sub_ns
            elif self.settings.locked:
                phase, hop = (first[0] + timing.round // 2) % timing.round, first[1]
                hop += 1 if phase < timing.round // 2 else -1
                sub_ns = first[2] if len(nodes) == LEAST_RADIOS else sub_ns
            self._others[node] = tuple(other for other in sorted(nodes) if other != node)
            self._radios[node] = SikRadio(
                self, node, self._others[node], words, order, phase=phase, hop=hop, sub_ns=sub_ns
            )

    def _wake(self, node: int) -> None:
        self._radios[node].wake()

    def _enter(self, packet: AirPacket) -> None:
        others = self._others.get(packet.node, ())
        if packet.to is not None and packet.to not in others:
            self._lost(packet, Loss.NO_PEER)
        elif others:
            super()._enter(packet)

    def _beside_bytes(self, node: int) -> int:
        radio = self._radios.get(node)
        return 0 if radio is None else radio.stream.begun_bytes

    def _passed(self, frame: AirFrame, receiver: int, loss: Loss | None) -> None:
        """A frame has passed a node."""
        if receiver not in self._others[frame.node]:
            return
        burst, left = self._bursts[frame]
        left.discard(receiver)
        if not left:
            del self._bursts[frame]
        if loss is None:
            self._radios[receiver].heard_peer(burst.trailer)
        for passage, length_bytes in burst.parts:
            if passage.passes(receiver, length_bytes, is_lost=loss is not None):
                self._book(passage.packet, receiver, frame, passage.frames, loss, passage.frames)
