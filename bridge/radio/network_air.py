"""One radio network of a run at the radio: its packets on their way, what becomes of them, and its books.

Columns and packets name nodes by their places among all of the run; the medium of a network that only some are on has
places of its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.bus.keys import ALL, MAIN
from bridge.bus.messages import Truth
from bridge.radio.node_places import NodePlaces
from bridge.radio.senders import TxPacket
from bridge.radio.serial_output import SerialOutput
from bridge.record.tables.deliveries import Cause, Gap, Vocabulary, columns_of, tick_of
from bridge.record.tables.schema import Columns
from channel.access.mavlink import handled
from channel.access.packets import Handling, Reply
from channel.access.settings.medium import goes_by_messages
from channel.medium.ledger import Ledger
from channel.medium.medium import Medium
from channel.medium.reception import EVERYBODY, Packets, Receptions
from channel.network.entry import FIRST_EXACT
from channel.network.network import Lived, Network, RadioRoute


class QueueOfNode(NamedTuple):
    """What waits in a transmit queue of a node."""

    node: int
    packets: int
    length_bytes: int
    network: int = 0


class ReplyToNode(NamedTuple):
    """What a sender learns of its unicast."""

    node: int
    reply: Reply
    network: int = 0


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
        queues: of transmit queues that changed.
        routes: that changed, each with the name of its network.
        serial: what has come out of modems.
    """

    packets: Sequence[TxPacket]
    receptions: Receptions
    gaps: Sequence[Gap]
    columns: Columns
    received_ns: int
    replies: Sequence[ReplyToNode] = ()
    queues: Sequence[QueueOfNode] = ()
    routes: Sequence[tuple[str, RadioRoute]] = ()
    serial: Sequence[SerialOutput] = ()


class NetworkAir:
    """One radio network.

    Args:
        medium: where its nodes are, and their radios.
        network: who transmits when; None: packets take no time.
        name: of the network, and of its nodes' radios.
        nodes: ids of all nodes of the run; those of the medium unless given.
        place: of the network among those of the run.

    Attributes:
        index: place among all nodes of each of its own, by id.
        addressees: `Packets.to` among all nodes, by the name of whom a packet may be for.
        ledger: its books; of its own nodes.
    """

    def __init__(
        self,
        medium: Medium,
        network: Network | None = None,
        *,
        name: str = MAIN,
        nodes: Sequence[str] = (),
        place: int = 0,
    ) -> None:
        self.name, self.place = name, place
        self.medium = medium
        self.nodes = tuple(nodes) or medium.nodes
        self._places = NodePlaces(medium.nodes, self.nodes)
        self.index = self._places.index
        groups = medium.addressees.groups
        codes = {name: medium.addressees.codes[name] for name in groups}
        known = {name: code for name, code in codes.items() if medium.addressees.members(code)}
        self.addressees = {ALL: EVERYBODY, **self.index, **known}
        self.ledger = Ledger(medium.nodes, causes=tuple(Cause), addressees=medium.addressees)
        self._network = network
        self._is_mavlink = goes_by_messages(medium.radios[0].config.medium)
        self._in_flight: dict[tuple[int, int], TxPacket] = {}
        """By place of the sender in the medium, and number."""
        self._queues: dict[int, tuple[int, int]] = {}

    @property
    def settled(self) -> NDArray[np.int64]:
        """Packets by what became of them, shape (nodes, nodes, causes), over all nodes of the run, senders first."""
        if self._places.are_same:
            return self.ledger.settled
        nodes, of_all = len(self.nodes), self._places.of_all
        found = np.zeros((nodes, nodes, len(self.ledger.causes)), dtype=np.int64)
        found[np.ix_(of_all, of_all)] = self.ledger.settled
        return found

    @property
    def mtu_bytes(self) -> Sequence[int]:
        """Longest payload that each node's radio takes; 0 for a node without one."""
        longest = {
            node: radio.config.mtu_bytes for node, radio in zip(self.index, self.medium.radios, strict=True)
        }
        return [longest.get(node, 0) for node in self.nodes]

    # What comes in.

    def observe(self, truths: Sequence[Truth]) -> None:
        """Take the true states of nodes that may be on it.

        Raises:
            ChannelInputError: they are no numbers that a radio can work with.
        """
        mine = (
            truths
            if self._places.are_same
            else [each for each in truths if each.header.frame_id in self.index]
        )
        if mine:
            self.medium.observe(
                [truth.header.frame_id for truth in mine],
                np.array([truth.header.stamp.ns for truth in mine]),
                [truth.position_ned_m.xyz for truth in mine],
                [(q.w, q.x, q.y, q.z) for q in (truth.attitude for truth in mine)],
            )

    def observe_emitter(self, truths: Sequence[Truth]) -> None:
        """Take the true state of an emitter.

        Raises:
            ChannelInputError: as `observe`.
        """
        [truth] = truths
        place = truth.position_ned_m.xyz
        self.medium.emitters.observe([truth.header.frame_id], truth.header.stamp.ns, [place])

    def switch_radio(self, node: str, sim_time_ns: int, *, on: bool) -> None:
        """Take note that a node's radios were switched."""
        if node in self.index:
            self.medium.switch_radio(node, sim_time_ns, on=on)

    def send(self, taken: Sequence[TxPacket]) -> None:
        """Give packets, in canonical order, to the medium."""
        packets = self.entered(taken)
        if self._network is None:
            self.medium.send(packets)
        else:
            self._network.send(packets, [packet.handling for packet in taken])

    def handling_of(self, payload: bytes, handling: Handling) -> Handling:
        """How a packet is handled: as its sender asks for, or by its MAVLink messages."""
        return handled(payload, handling) if self._is_mavlink else handling

    def entered(self, taken: Sequence[TxPacket]) -> Packets:
        """Take note of packets that are with the medium from now on; returns them as columns."""
        packets = self._places.on_the_network(packets_of(taken))
        keys = zip(packets.tx.tolist(), packets.seq.tolist(), strict=True)
        self._in_flight.update(zip(keys, taken, strict=True))
        self.ledger.send(packets)
        return packets

    def lose(self, gap: Gap) -> Sequence[Gap]:
        """Book packets that are lost before the channel; a gap for each of their receivers, or one for all nodes."""
        tx, cause = self.nodes[gap.tx], gap.cause.value
        if gap.to == EVERYBODY and self._places.are_same:
            self.ledger.lose(tx, cause, gap.packets)
            return (gap,)
        receivers = self._receivers_of(gap)
        for rx in receivers:
            self.ledger.lose(tx, cause, gap.packets, self.nodes[rx])
        return [gap._replace(to=rx) for rx in receivers]

    def _receivers_of(self, gap: Gap) -> list[int]:
        """Places among all nodes, rising."""
        if gap.to >= 0:
            return [gap.to]
        members = self._places.of_all.tolist()
        receivers = self.medium.addressees.receivers(self.medium.index[self.nodes[gap.tx]], gap.to)
        return [members[rx] for rx in sorted(receivers)]

    # What becomes of it.

    def settle(self, words: Vocabulary, received_ns: int) -> Settled:
        """What can be decided by now.

        Args:
            words: of the record.
            received_ns: the tick at which nodes get it.
        """
        if self._network is not None:
            return self._lived(self._network.live(received_ns), words, received_ns)
        return self._at_once(self.medium.settle(), words, received_ns)

    def finish(self, words: Vocabulary, received_ns: int, tick_period_ns: int) -> Settled:
        """Decide what still waits, with the newest positions, and balance the books.

        Raises:
            LedgerError: sent is not delivered plus lost: a defect of ours.
        """
        if self._network is not None:
            settled = self._lived(self._network.end(), words, received_ns)
        else:
            settled = self._at_once(self.medium.flush(), words, received_ns, tick_period_ns)
        self.ledger.check(in_flight=0)
        return settled

    def _at_once(
        self, receptions: Receptions, words: Vocabulary, received_ns: int, tick_period_ns: int = 0
    ) -> Settled:
        self.ledger.settle(receptions)
        done = receptions.packets
        packets = [self._in_flight.pop(key) for key in zip(done.tx.tolist(), done.seq.tolist(), strict=True)]
        came_ns = np.full(done.size, received_ns)
        if tick_period_ns:  # the run is over: what was stamped ahead would have come later
            came_ns = np.maximum(came_ns, tick_of(done.sim_time_ns, tick_period_ns) + tick_period_ns)
        said = words.of(packets, self.name) | {"received_ns": came_ns}
        counted_bytes = self.medium.counted_bytes(done)
        receptions = self._places.among_all(receptions)
        return Settled(packets, receptions, (), columns_of(receptions, counted_bytes, said), received_ns)

    def _lived(self, lived: Lived, words: Vocabulary, received_ns: int) -> Settled:
        """What became of packets on a network, which may take long to be decided for all receivers."""
        receptions, done = lived.receptions, lived.receptions.packets
        self.ledger.book(receptions)
        if lived.first:
            self.ledger.place(Receptions.joined(lived.first))
        packets = [self._in_flight[key] for key in zip(done.tx.tolist(), done.seq.tolist(), strict=True)]
        for key in lived.done:
            del self._in_flight[key]
        said = words.of(packets, self.name) | {"received_ns": np.full(done.size, received_ns)}
        counted_bytes = self.medium.counted_bytes(done)
        receptions = self._places.among_all(receptions)
        columns = columns_of(receptions, counted_bytes, said, lived.instants)
        members = self._places.of_all.tolist()
        replies = [
            ReplyToNode(members[each.packet.node], each, self.place)
            for each in lived.replies
            if each.packet.number < FIRST_EXACT  # those of modems are no agent's
        ]
        queues, routes = tuple(self._changed_queues()), self._named_routes(lived)
        return Settled(packets, receptions, (), columns, received_ns, replies, queues, routes)

    def _named_routes(self, lived: Lived) -> list[tuple[str, RadioRoute]]:
        """Routes that changed, with places among all nodes."""
        return [(self.name, each.among(self._places.of_all.tolist())) for each in lived.routes]

    def _changed_queues(self) -> Iterator[QueueOfNode]:
        assert self._network is not None
        for node, place in enumerate(self._places.of_all.tolist()):
            queued = self._network.queued(node)
            if queued != self._queues.get(node, (0, 0)):
                self._queues[node] = queued
                yield QueueOfNode(place, *queued, self.place)


def packets_of(taken: Sequence[TxPacket]) -> Packets:
    """Packets as columns."""
    return Packets(
        np.array([p.sim_time_ns for p in taken], dtype=np.int64),
        np.array([p.tx for p in taken], dtype=np.intp),
        np.array([p.seq for p in taken], dtype=np.int64),
        np.array([len(p.payload) for p in taken], dtype=np.int64),
        np.array([p.to for p in taken], dtype=np.intp),
    )


def joined(parts: Sequence[Settled]) -> Settled:
    """What became of packets on several networks, in the order of arrival; of one instant in that of the networks."""
    columns = {name: np.concatenate([part.columns[name] for part in parts]) for name in parts[0].columns}
    order = np.argsort(columns["arrived_ns"], kind="stable")
    return Settled(
        [packet for part in parts for packet in part.packets],
        Receptions.joined([part.receptions for part in parts]).at(order),
        (),
        {name: values[order] for name, values in columns.items()},
        parts[0].received_ns,
        [reply for part in parts for reply in part.replies],
        [queue for part in parts for queue in part.queues],
        [route for part in parts for route in part.routes],
    )
