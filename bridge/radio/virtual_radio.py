"""The virtual radio: everything that one node transmits goes through here, and what survives goes on.

`VirtualRadio` is the core: it takes packets, true positions and answers to ticks, and says what became of them. It
knows no Zenoh: the process around it is `bridge.radio.process`.

The router also closes each tick: once every regulated node has answered it, all packets of that tick are settled at
once, in one order whoever was first, and on their way; only then is the fleet clock released. So no packet is late
because the host was slow, and a run does not depend on how fast it went.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.bus.handling import PLAIN, Handling
from bridge.bus.keys import ALL, MAIN, Address
from bridge.bus.messages import Truth
from bridge.bus.session import Stamp
from bridge.radio.ring import Closed, Ring
from bridge.radio.senders import Refused, Senders, TxPacket
from bridge.record.tables.deliveries import Cause, Gap, Vocabulary, columns_of, tick_of
from bridge.record.tables.schema import Columns
from channel.access.packets import Reply
from channel.checks import ChannelInputError
from channel.medium.ledger import Ledger
from channel.medium.medium import Medium
from channel.medium.reception import EVERYBODY, Packets, Receptions
from channel.network.network import Lived, Network

FUTURE_MAX_NS = 10_000_000_000
"""A sim time further ahead of the newest truth than this is garbage."""
ENCODING_MAX = 1000
"""Characters that a program may say of a payload."""
AHEAD_MAX_NS = 1_000_000_000
"""A packet further ahead than this is: what waits for its truth has to be bounded."""


class QueueOfNode(NamedTuple):
    """What waits in a node's transmit queue."""

    node: int
    packets: int
    length_bytes: int


@dataclass(frozen=True, slots=True)
class Settled:
    """What became of packets.

    Attributes:
        packets: those that were settled; ``receptions.packet`` is an index into them.
        receptions: their fates, as columns.
        gaps: packets that were lost before the channel.
        columns: of the receptions, as the table of deliveries has them.
        received_ns: the tick at which nodes get them.
        replies: what senders learn of their unicasts.
        queues: of nodes whose transmit queue changed.
    """

    packets: Sequence[TxPacket]
    receptions: Receptions
    gaps: Sequence[Gap]
    columns: Columns
    received_ns: int
    replies: Sequence[Reply] = ()
    queues: Sequence[QueueOfNode] = ()


class VirtualRadio:
    """Settles the fate of each packet for each node that it is meant for. No I/O, no clock.

    Args:
        medium: the channel's medium.
        ring: who is waited for.
        mtu_bytes: longest payload that each node's radio takes, by node id.
        network: who transmits when; None: packets take no time.
    """

    def __init__(
        self, medium: Medium, ring: Ring, mtu_bytes: Mapping[str, int], network: Network | None = None
    ) -> None:
        self.nodes = medium.nodes
        self.ring = ring
        self.words = Vocabulary()
        self.ledger = Ledger(self.nodes, causes=tuple(Cause))
        self.transmitted: list[TxPacket] = []
        """Packets given to the medium, in canonical order; whoever writes them clears the list."""
        self._medium, self._network = medium, network
        self._index = {node: index for index, node in enumerate(self.nodes)}
        self._emitters = frozenset(medium.emitters.names)
        self._senders = Senders([mtu_bytes[node] for node in self.nodes], self._book_gap)
        self.refused = self._senders.refused
        self._latest_ns = 0
        self._in_flight: dict[tuple[int, int], TxPacket] = {}
        self._queues: dict[int, tuple[int, int]] = {}
        self._gaps: list[Gap] = []

    # What comes in.

    def on_truths(self, truths: Sequence[Truth]) -> None:
        """Take the true states of nodes, each once, in the fleet's frame."""
        good = [truth for truth in truths if self._is_good(truth)]
        nodes = [truth for truth in good if truth.header.frame_id in self._index]
        emitters = [truth for truth in good if truth.header.frame_id in self._emitters]
        one_by_one = [(self._observe_emitter, each) for each in emitters]
        if nodes and not self._took(self._observe, nodes):
            one_by_one += [(self._observe, each) for each in nodes]
        for observe, each in one_by_one:
            if not self._took(observe, [each]):
                self.refused[Refused.MALFORMED] += 1

    def _is_good(self, truth: Truth) -> bool:
        node = truth.header.frame_id
        if node not in self._index and node not in self._emitters:
            self.refused[Refused.UNKNOWN_NODE] += 1
        elif not self._is_plausible(truth.header.stamp.ns):
            self.refused[Refused.MALFORMED] += 1
        else:
            return True
        return False

    def _took(self, observe: Callable[[Sequence[Truth]], None], truths: Sequence[Truth]) -> bool:
        """Whether they are numbers that a radio can work with."""
        try:
            observe(truths)
        except ChannelInputError:
            return False
        self._latest_ns = max(self._latest_ns, *(truth.header.stamp.ns for truth in truths))
        return True

    def _observe(self, truths: Sequence[Truth]) -> None:
        self._medium.observe(
            [truth.header.frame_id for truth in truths],
            np.array([truth.header.stamp.ns for truth in truths]),
            [truth.position_ned_m.xyz for truth in truths],
            [(q.w, q.x, q.y, q.z) for q in (truth.attitude for truth in truths)],
        )

    def _observe_emitter(self, truths: Sequence[Truth]) -> None:
        [truth] = truths
        place = truth.position_ned_m.xyz
        self._medium.emitters.observe([truth.header.frame_id], truth.header.stamp.ns, [place])

    def on_packet(
        self,
        address: Address,
        payload: bytes,
        encoding: str,
        stamp: Stamp | None,
        handling: Handling = PLAIN,
    ) -> bool:
        """Take a packet with its sender's stamp; returns whether it was. `settle` decides its fate."""
        why = self._why_refused(address, encoding, stamp)
        if stamp is None or why is not None:
            self.refused[why or Refused.WITHOUT_STAMP] += 1
            return False
        to = EVERYBODY if address.to == ALL else self._index[address.to]
        route = f"{address.radio}/{address.to}/{address.channel}"
        tx = self._index[address.node]
        return self._senders.take(
            TxPacket(stamp.seq, stamp.sim_time_ns, route, payload, encoding, handling, tx=tx, to=to)
        )

    def _why_refused(self, address: Address, encoding: str, stamp: Stamp | None) -> Refused | None:
        if address.node not in self._index:
            return Refused.UNKNOWN_NODE
        if stamp is None:
            return Refused.WITHOUT_STAMP
        if address.radio != MAIN:
            return Refused.UNKNOWN_RADIO
        if address.to == address.node or (address.to != ALL and address.to not in self._index):
            return Refused.UNKNOWN_ADDRESS
        if len(encoding) > ENCODING_MAX:
            return Refused.MALFORMED
        return None if 0 <= stamp.sim_time_ns <= self._latest_ns + AHEAD_MAX_NS else Refused.MALFORMED

    def _is_plausible(self, sim_time_ns: int) -> bool:
        return 0 <= sim_time_ns <= self._latest_ns + FUTURE_MAX_NS

    def on_tick(self, sim_time_ns: int) -> None:
        """Take a tick of the fleet clock."""
        if not self._is_plausible(sim_time_ns):
            self.refused[Refused.MALFORMED] += 1
            return
        self._latest_ns = max(self._latest_ns, sim_time_ns)
        self.ring.tick(sim_time_ns)

    def on_switch(self, node: str, sim_time_ns: int, *, on: bool) -> None:
        """Take a node's word that an operator switched its radio; it comes ahead of its answer to that instant."""
        if node not in self._index:
            self.refused[Refused.UNKNOWN_NODE] += 1
        elif not self._is_plausible(sim_time_ns):
            self.refused[Refused.MALFORMED] += 1
        else:
            self._medium.switch_radio(node, sim_time_ns, on=on)

    def on_answer(self, node: str, sim_time_ns: int) -> Closed | None:
        """Take a node's word that it has done all it will do at a tick, or at an exchange of MAVLink between two."""
        if node not in self.ring or not self._is_plausible(sim_time_ns):
            self.refused[Refused.MALFORMED if node in self.ring else Refused.UNKNOWN_NODE] += 1
            return None
        return self.ring.answer(node, sim_time_ns)

    def radios_off(self, sim_time_ns: int) -> NDArray[np.bool_]:
        """Which radios are off at an instant, in the order of `nodes`."""
        return self._medium.radios_off(sim_time_ns)

    def on_sent_total(self, node: str, sent: int) -> None:
        """Take a sender's own count of what it gave to the radio; what never came here is booked."""
        if node not in self._index:
            self.refused[Refused.UNKNOWN_NODE] += 1
        elif not self._senders.told_total(self._index[node], sent, self._latest_ns):
            self.refused[Refused.MALFORMED] += 1

    def next_packet(self, node: str) -> Stamp:
        """What the next packet of ``node`` may be stamped with."""
        seq, latest_ns = self._senders.next_packet(self._index[node])
        return Stamp(seq, max(latest_ns, self._latest_ns))

    def on_dropped(self, node: str, seq: int) -> None:
        """Take note that the process dropped a node's packets up to number ``seq``: too much came at once."""
        if node in self._index and not self._senders.told_total(self._index[node], seq + 1, self._latest_ns):
            self.refused[Refused.MALFORMED] += 1

    # What becomes of it.

    def settle(self) -> Settled:
        """Give what was taken to the medium, and take from it what it can decide."""
        self._send()
        if self._network is not None:
            return self._lived(self._network, self._network.live(self.ring.received_ns))
        return self._settled(self._medium.settle())

    def finish(self) -> Settled:
        """Settle what still waits, with the newest positions, and balance the books.

        Raises:
            LedgerError: sent is not delivered plus lost: a defect of ours.
        """
        self._send()
        if self._network is not None:
            settled = self._lived(self._network, self._network.end())
        else:
            settled = self._settled(self._medium.flush(), is_over=True)
        self.ledger.check(in_flight=0)
        return settled

    def _send(self) -> None:
        taken = self._senders.taken()
        if not taken:
            return
        self.transmitted += taken
        self._in_flight.update(((packet.tx, packet.seq), packet) for packet in taken)
        packets = packets_of(taken)
        self.ledger.send(packets)
        if self._network is None:
            self._medium.send(packets)
        else:
            self._network.send(packets, [packet.handling for packet in taken])

    def _settled(self, receptions: Receptions, *, is_over: bool = False) -> Settled:
        self.ledger.settle(receptions)
        done = receptions.packets
        packets = [self._in_flight.pop(key) for key in zip(done.tx.tolist(), done.seq.tolist(), strict=True)]
        gaps = self._taken_gaps()
        came_ns = np.full(done.size, self.ring.received_ns)
        if is_over:  # what was stamped ahead would have come later
            period_ns = self.ring.tick_period_ns
            came_ns = np.maximum(came_ns, tick_of(done.sim_time_ns, period_ns) + period_ns)
        said = self.words.of(packets) | {"received_ns": came_ns}
        columns = columns_of(receptions, self._medium.counted_bytes(done), said)
        return Settled(packets, receptions, gaps, columns, self.ring.received_ns)

    def _lived(self, network: Network, lived: Lived) -> Settled:
        """What became of packets on a network, which may take long to be decided for all receivers."""
        receptions, done = lived.receptions, lived.receptions.packets
        self.ledger.book(receptions)
        if lived.first:
            self.ledger.place(Receptions.joined(lived.first))
        packets = [self._in_flight[key] for key in zip(done.tx.tolist(), done.seq.tolist(), strict=True)]
        for key in lived.done:
            del self._in_flight[key]
        said = self.words.of(packets) | {"received_ns": np.full(done.size, self.ring.received_ns)}
        columns = columns_of(receptions, self._medium.counted_bytes(done), said, lived.instants)
        replies, queues = lived.replies, tuple(self._changed_queues(network))
        return Settled(
            packets, receptions, self._taken_gaps(), columns, self.ring.received_ns, replies, queues
        )

    def _changed_queues(self, network: Network) -> Iterator[QueueOfNode]:
        for node in range(len(self.nodes)):
            queued = network.queued(node)
            if queued != self._queues.get(node, (0, 0)):
                self._queues[node] = queued
                yield QueueOfNode(node, *queued)

    def _taken_gaps(self) -> Sequence[Gap]:
        gaps, self._gaps = sorted(self._gaps, key=_place_of), []  # whoever was first
        return gaps

    def _book_gap(self, gap: Gap) -> None:
        to = None if gap.to == EVERYBODY else self.nodes[gap.to]
        self.ledger.lose(self.nodes[gap.tx], gap.cause.value, gap.packets, to)
        self._gaps.append(gap)


def _place_of(gap: Gap) -> tuple[int, int, int]:
    """Where a gap stands among those of a tick."""
    return gap.sim_time_ns, gap.tx, gap.first_seq


def packets_of(taken: Sequence[TxPacket]) -> Packets:
    """Packets as columns."""
    return Packets(
        np.array([p.sim_time_ns for p in taken], dtype=np.int64),
        np.array([p.tx for p in taken], dtype=np.intp),
        np.array([p.seq for p in taken], dtype=np.int64),
        np.array([len(p.payload) for p in taken], dtype=np.int64),
        np.array([p.to for p in taken], dtype=np.intp),
    )
