"""ExpressLRS with MAVLink: pairs of a transmitter module and a receiver that take slots in turn.

By the source of ExpressLRS, commit 7702d0f: `tx_main.cpp`, `rx_main.cpp`, `lib/StubbornSender`, `lib/StubbornReceiver`,
`rx-serial/SerialMavlink`. The transmitter has every second slot, for channels of the remote control, data and, at
times, sync; the receiver has the others, for data and link statistics. Each frame but sync also confirms, by one bit,
the data of the other direction. Data are a stream of bytes, sent in chunks of at most 62.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from channel.access.agenda import SIGNAL_ENDS, SIGNAL_STARTS
from channel.access.elrs_modes import (
    CHUNK_BYTES,
    CHUNK_HEAD_BYTES,
    ELRS_MODES,
    STATS_BYTES,
    SYNC_MS,
    ElrsMode,
)
from channel.access.media.medium import AccessMedium
from channel.access.packets import AirFrame, AirPacket, Loss
from channel.access.queue import QueueLimits
from channel.access.stubborn import Fragment, StubbornReceiver, StubbornSender, are_whole
from channel.access.timing import US
from channel.access.words import WordStream
from channel.access.world import Piece, World
from channel.draws import Draws

__all__ = ["ELRS_MODES", "Elrs", "ElrsMode", "ElrsSettings"]

RC, DATA, SYNC, STATS = "rc", "data", "sync", "stats"
RESYNC_UP, RESYNC_DOWN, RESYNC_DOWN_LONG = 14, 127, 31
"""Numbers of resync fragments: up, and down in packets of 8 and of 13 bytes."""
PATIENCE_UP, PATIENCE_DOWN = 80, 40
"""Wrong confirmations in a row: the default, which a transmitter keeps, and 20 times two slots, of a receiver."""
HOPS: Final = 256
"""Of a sequence at most (`FHSS_SEQUENCE_LEN`)."""
NS_PER_MS: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class ElrsSettings:
    """Of all pairs of a medium.

    Attributes:
        mode: one of `ELRS_MODES`, or one's own.
        pairs: (transmitter, receiver) each; empty: the nodes two by two in their order.
        has_rc: whether channels of a remote control have every second slot of the transmitter while it has data.
        buffer_bytes: that wait at each end.
        begins_us: when the first slot of each pair begins; None: drawn, within two slots.
    """

    mode: ElrsMode = ELRS_MODES["lora-500"]
    pairs: tuple[tuple[int, int], ...] = ()
    has_rc: bool = True
    buffer_bytes: int = 1024
    begins_us: int | None = None


@dataclass(slots=True, eq=False)
class _Entered:
    """A packet of which bytes are in chunks; `frames` have carried them."""

    packet: AirPacket
    left_bytes: int
    chunks: int = 0
    frames: int = 0
    is_lost: bool = False


@dataclass(slots=True, eq=False)
class _Chunk:
    """What is sent as one: packets with bytes in it, and whether each ends here."""

    length_bytes: int
    packets: list[tuple[_Entered, bool]]
    has_come: bool = False


@dataclass(slots=True, eq=False)
class _Way:
    """One direction of a pair.

    Attributes:
        node, peer: who sends, and who hears.
        chunk: that is on its way, or was the last.
        rest: the packet of which the last bytes are in no chunk yet.
        frames: transmissions so far.
        heard_ns: when the peer heard the last frame.
        is_heard: whether the peer takes the link for up.
    """

    node: int
    peer: int
    sender: StubbornSender
    receiver: StubbornReceiver
    chunk: _Chunk | None = None
    rest: _Entered | None = None
    frames: int = 0
    heard_ns: int = 0
    is_heard: bool = True


@dataclass(slots=True, eq=False)
class _Pair:
    """Two ways, and where they are in what comes again and again.

    Attributes:
        hop: of slot 0, as a place in the order.
        order: of frequencies, until it comes again; each round of all of them begins with that of sync.
        synced_ns: when the last sync was sent.
        burst: data frames since the last with statistics.
        begins_ns: when slot 0 begins.
        is_turn_of_data: whether data go up next, and not RC.
        channel: the frequency of the present slot.
    """

    up: _Way
    down: _Way
    hop: int
    order: tuple[int, ...]
    synced_ns: int
    burst: int
    begins_ns: int
    is_turn_of_data: bool = True
    channel: int = 0


class Elrs(AccessMedium):
    """Pairs of ExpressLRS radios.

    Pairs hop over frequencies of their own and do not disturb each other. A packet to a node that is not the peer is
    lost. Nobody is told whether a unicast came: its sender has a `Reply` only if it never was on the air. At instant 0
    all links are up; when the first slot begins, on which hop, and how long ago sync and statistics were sent is drawn.

    Args:
        world: nodes, powers, losses.
        settings: of the pairs.
        seed: of when pairs began.

    Raises:
        ValueError: a pair of nodes that are not there, or a node in two pairs.
    """

    def __init__(self, world: World, settings: ElrsSettings | None = None, *, seed: int = 1) -> None:
        self.settings = settings or ElrsSettings()
        self.mode = self.settings.mode
        limit_bytes = self.settings.buffer_bytes
        super().__init__(world, QueueLimits(0, limit_bytes), limit_bytes)
        self._pairs: dict[int, _Pair] = {}
        self._ways: dict[int, _Way] = {}
        draws = Draws(seed)
        for transmitter, receiver in self.settings.pairs or _two_by_two(world.nodes):
            order = hop_sequence(self.mode.channels, WordStream(draws, self.ids[transmitter], "hops"))
            words = WordStream(draws, self.ids[transmitter], "phases")
            pair = self._join(transmitter, receiver, words, order)
            self.agenda.at(pair.begins_ns, SIGNAL_STARTS, transmitter, self._slot, pair, 0)

    def _join(self, transmitter: int, receiver: int, words: WordStream, order: tuple[int, ...]) -> _Pair:
        for node in (transmitter, receiver):
            if node not in self._outboxes or node in self._ways or transmitter == receiver:
                raise ValueError(
                    f"pair {transmitter}, {receiver}: two nodes of the network, in no other pair"
                )
        resync = RESYNC_DOWN if self.mode.data_bytes == 5 else RESYNC_DOWN_LONG
        begins_us = self.settings.begins_us
        up, down = StubbornSender(RESYNC_UP, PATIENCE_UP), StubbornSender(resync, PATIENCE_DOWN)
        pair = _Pair(
            _Way(transmitter, receiver, up, StubbornReceiver(RESYNC_UP)),
            _Way(receiver, transmitter, down, StubbornReceiver(resync)),
            hop=words.below(len(order)),
            order=order,
            synced_ns=-words.below(SYNC_MS) * NS_PER_MS,
            burst=words.below(self.mode.burst + 1),
            begins_ns=US * (words.below(2 * self.mode.interval_us) if begins_us is None else begins_us),
        )
        self._ways[transmitter], self._ways[receiver] = pair.up, pair.down
        self._pairs[transmitter] = self._pairs[receiver] = pair
        return pair

    def receivers_of(self, packet: AirPacket) -> tuple[int, ...]:
        """The node that it is for; if it is for several, the peer, if it is one of them."""
        if packet.to is not None:
            return (packet.to,)
        way = self._ways.get(packet.node)
        return (way.peer,) if way is not None and packet.is_for(way.peer) else ()

    # What enters.

    def _enter(self, packet: AirPacket) -> None:
        way = self._ways.get(packet.node)
        if way is None or packet.to not in (None, way.peer):
            self._lost(packet, Loss.NO_PEER)
            return
        pair = self._pairs[packet.node]
        if way is pair.down and not pair.up.is_heard:
            self._lost(packet, self._why_down(packet, way))
        else:
            super()._enter(packet)

    def _beside_bytes(self, node: int) -> int:
        way = self._ways.get(node)
        return 0 if way is None or way.rest is None else way.rest.left_bytes

    def _wake(self, node: int) -> None:
        way = self._ways[node]
        if way.sender.is_idle:
            self._load(way)

    def _load(self, way: _Way) -> None:
        """Take the next chunk, if a byte waits; an empty packet counts as one byte."""
        room_bytes, packets = CHUNK_BYTES, []
        while room_bytes:
            entered = way.rest
            if entered is None:
                packet = self._next(way.node)
                if packet is None:
                    break
                entered = _Entered(packet, max(1, packet.length_bytes))
            taken = min(room_bytes, entered.left_bytes)
            entered.left_bytes -= taken
            entered.chunks += 1
            room_bytes -= taken
            way.rest = entered if entered.left_bytes else None
            packets.append((entered, not entered.left_bytes))
        if packets:
            length_bytes = CHUNK_HEAD_BYTES + CHUNK_BYTES - room_bytes
            way.chunk = _Chunk(length_bytes, packets)
            way.sender.load(length_bytes)

    # Slots.

    def _slot(self, pair: _Pair, index: int) -> None:
        """A slot begins: even ones are the transmitter's."""
        now_ns, mode = self.agenda.now_ns, self.mode
        at_ns = pair.begins_ns + (index + 1) * mode.interval_us * US
        self.agenda.at(at_ns, SIGNAL_STARTS, pair.up.node, self._slot, pair, index + 1)
        hop = (pair.hop + index // mode.hop_slots) % len(pair.order)
        pair.channel = pair.order[hop]
        if index % 2:
            if now_ns - pair.up.heard_ns > mode.lost_ms * NS_PER_MS:
                pair.up.is_heard = False
            if pair.up.is_heard:
                self._send_down(pair)
            return
        if now_ns - pair.down.heard_ns > mode.lost_down_ms * NS_PER_MS:
            pair.down.is_heard = False
        self._send_up(pair, is_sync_channel=hop % mode.channels == 0)

    def _send_up(self, pair: _Pair, *, is_sync_channel: bool) -> None:
        now_ns, way, has_rc = self.agenda.now_ns, pair.up, self.settings.has_rc
        sync_ms = SYNC_MS if pair.down.is_heard else self.mode.sync_lost_ms
        if is_sync_channel and now_ns - pair.synced_ns > sync_ms * NS_PER_MS:
            pair.synced_ns = now_ns
            self._transmit(pair, way, SYNC, Fragment(0))
        elif has_rc and (way.sender.is_idle or not pair.is_turn_of_data):
            pair.is_turn_of_data = True
            self._transmit(pair, way, RC, Fragment(0))
        else:
            pair.is_turn_of_data = False
            self._transmit(pair, way, DATA, way.sender.fragment(self.mode.data_bytes))

    def _send_down(self, pair: _Pair) -> None:
        way, mode = pair.down, self.mode
        if pair.burst >= mode.burst or way.sender.is_idle:
            pair.burst = 0
            self._transmit(pair, way, STATS, way.sender.fragment(mode.data_bytes - STATS_BYTES))
        else:
            pair.burst += 1
            self._transmit(pair, way, DATA, way.sender.fragment(mode.data_bytes))

    def _transmit(self, pair: _Pair, way: _Way, kind: str, fragment: Fragment) -> None:
        now_ns, mode = self.agenda.now_ns, self.mode
        ended_ns, slot_ends_ns = now_ns + mode.air_us * US, now_ns + mode.interval_us * US
        frame = AirFrame(
            way.node,
            way.frames,
            kind,
            mode.packet_bytes,
            now_ns,
            ended_ns,
            to=way.peer,
            channel=pair.channel,
            in_turn=True,
        )
        way.frames += 1
        if fragment.length and way.chunk is not None:
            for entered, _ in way.chunk.packets:
                entered.frames += 1
        confirms = (pair.down if way is pair.up else pair.up).receiver.bit
        for receiver, power_mw, delay_ns in self.world.reach(frame):
            if receiver == way.peer and ended_ns + delay_ns < slot_ends_ns:
                arguments = (pair, frame, power_mw, fragment, confirms)
                self.agenda.at(ended_ns + delay_ns, SIGNAL_ENDS, receiver, self._arrives, *arguments)

    # What is heard.

    def _arrives(
        self, pair: _Pair, frame: AirFrame, power_mw: float, fragment: Fragment, confirms: bool
    ) -> None:
        """A frame is at the peer."""
        is_up = frame.node == pair.up.node
        way, back = (pair.up, pair.down) if is_up else (pair.down, pair.up)
        whole = [Piece(frame.ended_ns - frame.started_ns, 0.0)]
        if is_up and not way.is_heard and frame.kind != SYNC:
            return  # without a link a receiver waits on the frequency of sync
        if not self.world.survives(frame, way.peer, power_mw, whole)[0]:
            return
        way.heard_ns = self.agenda.now_ns
        if not way.is_heard:
            way.is_heard = True
            if not is_up:
                self._flush(pair.up)
        if frame.kind == SYNC:
            return
        self._confirm(back, confirms)
        if frame.kind != RC:
            self._take(way, frame, fragment)

    def _flush(self, way: _Way) -> None:
        """A transmitter that has found its link again forgets what waits."""
        if way.rest is not None:
            self._damaged(way, way.rest, None, self._why_down(way.rest.packet, way))
            way.rest = None
        while (packet := self._next(way.node)) is not None:
            self._lost(packet, self._why_down(packet, way))

    def _why_down(self, packet: AirPacket, way: _Way) -> Loss:
        """Why a packet meets a link that is down: a partition was between its ends when it was given."""
        return Loss.PARTITIONED if self.are_apart(way.node, way.peer, packet.at_ns) else Loss.OUTAGE

    def _confirm(self, way: _Way, bit: bool) -> None:
        """A confirmation came to the sender of a way."""
        sender, resynced = way.sender, way.sender.resyncs
        sender.confirm(bit)
        if sender.resyncs and not resynced:
            self._drop(way, None, Loss.RETRIES)
        if sender.is_idle:
            self._load(way)

    def _take(self, way: _Way, frame: AirFrame, fragment: Fragment) -> None:
        """Data came to the peer of a way: packets arrive with the chunk in which they end."""
        parts, chunk = way.receiver.take(fragment), way.chunk
        if parts is None or chunk is None:
            return
        if not are_whole(parts, chunk.length_bytes):
            self._drop(way, frame, Loss.NOISE)
            return
        chunk.has_come = True
        for entered, ends in chunk.packets:
            if ends and not entered.is_lost:
                self._book(entered.packet, way.peer, frame, entered.frames, None, entered.chunks)

    def _drop(self, way: _Way, frame: AirFrame | None, loss: Loss) -> None:
        """All packets with bytes in the present chunk are lost, unless it came."""
        if way.chunk is not None and not way.chunk.has_come:
            way.chunk.has_come = True
            for entered, _ in way.chunk.packets:
                self._damaged(way, entered, frame, loss)

    def _damaged(self, way: _Way, entered: _Entered, frame: AirFrame | None, loss: Loss) -> None:
        if not entered.is_lost:
            entered.is_lost = True
            self._book(entered.packet, way.peer, frame, entered.frames, loss)


def _two_by_two(nodes: Sequence[int]) -> list[tuple[int, int]]:
    """Neighbours in the order of the nodes; an odd one out has no peer."""
    return list(zip(nodes[::2], nodes[1::2], strict=False))


def hop_sequence(channels: int, words: WordStream) -> tuple[int, ...]:
    """The frequencies in the order of a pair, until it comes again: rounds that begin with that of sync, the middle.

    The firmware draws the others anew for each of the rounds that fit in 256 hops, by the binding phrase (`FHSS.cpp`).
    """
    sync = channels // 2
    sequence: list[int] = []
    for _ in range(max(1, HOPS // channels)):
        others = [channel for channel in range(channels) if channel != sync]
        for place in range(len(others) - 1, 0, -1):
            other = words.below(place + 1)
            others[place], others[other] = others[other], others[place]
        sequence += [sync, *others]
    return tuple(sequence)
