"""The recorded transmissions on one radio network, decided anew."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from bridge.radio.ledger_file import Books
from bridge.radio.node_places import NodePlaces
from bridge.record.tables.deliveries import FATES, FIGURES, INSTANTS, TOO_LONG, Cause, columns_of, tick_of
from bridge.record.tables.schema import Columns
from bridge.record.tables.truth import TrueStates
from bridge.scenario.resolve.channel import RadioChannel
from channel.access.packets import Handling
from channel.medium.ledger import Ledger
from channel.medium.reception import EVERYBODY, Packets, Receptions
from channel.network.entry import FIRST_EXACT
from channel.network.instants import NEVER_NS
from channel.network.network import Network, RadioRoute
from lostlink.redecision.packet_facts import PacketFacts
from lostlink.redecision.settling import live, settle

OnDone = Callable[[int], object]
"""Called with how many packets were decided since the last call."""


@dataclass(frozen=True, slots=True)
class Transmissions:
    """What the nodes of a run gave to their radios on one network.

    Attributes:
        nodes: ids of all nodes of the run, whose places columns have.
        packets: in canonical order.
        handling: of those that are not plain, by sender and number.
        lost: rows of what never came to the radio.
        positions: where all stations were.
        tick_period_ns: of the run.
        facts: what is known of the packets.
    """

    nodes: tuple[str, ...]
    packets: Packets
    handling: Mapping[tuple[int, int], Handling]
    lost: Columns
    positions: TrueStates
    tick_period_ns: int
    facts: PacketFacts


class NetworkAnew:
    """A network's packets through its channel.

    Args:
        channel: of the network, which got nothing yet.
        sent: what its nodes transmitted.

    Attributes:
        rows: of its packets so far, as the table of deliveries has them.
        routes: that changed so far, each with the name of the network.
    """

    def __init__(self, channel: RadioChannel, sent: Transmissions) -> None:
        self._channel, self._sent = channel, sent
        self._places = NodePlaces(channel.medium.nodes, sent.nodes)
        medium = channel.medium
        self._ledger = Ledger(medium.nodes, causes=tuple(Cause), addressees=medium.addressees)
        self.rows: list[Columns] = []
        self.routes: list[tuple[str, RadioRoute]] = []

    def steps(self, on_done: OnDone) -> Iterator[None]:
        """Decide all its packets; yields where networks in its band have to come as far before it goes on.

        Raises:
            LedgerError: sent is not delivered plus lost: a defect of ours.
        """
        packets, too_long = self._split()
        self.rows += [self._too_long_rows(too_long), self._sent.lost]
        for part in self.rows:
            self._book(part)
        packets = self._places.on_the_network(packets)
        self._ledger.send(packets)
        network = self._channel.network
        decided = self._at_once(packets) if network is None else self._lived(packets, network)
        for rows, done in decided:
            if rows is not None:
                self.rows.append(rows)
                on_done(done)
            yield
        self._ledger.check(in_flight=0)

    @property
    def books(self) -> Books:
        """What was sent and what became of it, when all steps are done."""
        return Books.of(self._channel, self._ledger)

    def _at_once(self, packets: Packets) -> Iterator[tuple[Columns | None, int]]:
        medium, facts = self._channel.medium, self._sent.facts
        due_ns = tick_of(packets.sim_time_ns, self._sent.tick_period_ns)
        for receptions in settle(medium, self._positions(), packets, due_ns):
            self._ledger.settle(receptions)
            counted_bytes = medium.counted_bytes(receptions.packets)
            found = self._places.among_all(receptions)
            came = {"received_ns": facts.received_ns(found.packets.seq, found.packets.tx)}
            yield columns_of(found, counted_bytes, came), found.packets.size

    def _lived(self, packets: Packets, network: Network) -> Iterator[tuple[Columns | None, int]]:
        medium, period_ns = self._channel.medium, self._sent.tick_period_ns
        due_ns = _stretch_of(packets, period_ns)
        index, nodes = self._channel.medium.index, self._sent.nodes
        handling = {
            (index[nodes[tx]], seq): how
            for (tx, seq), how in self._sent.handling.items()
            if nodes[tx] in index
        }
        steps = live(network, medium, self._positions(), packets, due_ns, handling, period_ns)
        for tick_ns, lived in steps:
            if lived is None:
                yield None, 0
                continue
            self._ledger.book(lived.receptions)
            members = self._places.of_all.tolist()
            self.routes += [(self._channel.name, each.among(members)) for each in lived.routes]
            if lived.first:
                self._ledger.place(Receptions.joined(lived.first))
            settled = lived.receptions.packets
            came = {"received_ns": np.full(settled.size, tick_ns)}
            found, counted_bytes = self._places.among_all(lived.receptions), medium.counted_bytes(settled)
            yield columns_of(found, counted_bytes, came, lived.instants), len(lived.done)

    def _positions(self) -> TrueStates:
        """Where the nodes of the network and the emitters were."""
        positions = self._sent.positions
        if self._places.are_same:
            return positions
        emitters = positions.nodes[len(self._sent.nodes) :]
        stations = (*self._channel.medium.nodes, *emitters)
        place = np.full(len(positions.nodes), -1, dtype=np.intp)
        place[[positions.nodes.index(station) for station in stations]] = np.arange(len(stations))
        kept = positions.at(place[positions.node] >= 0)
        return replace(kept, nodes=stations, node=place[kept.node])

    def _split(self) -> tuple[Packets, Packets]:
        """Packets that their senders' radios take, and those that are too long for them."""
        packets = self._sent.packets
        mtu_bytes = np.zeros(len(self._sent.nodes), dtype=np.int64)
        mtu_bytes[self._places.of_all] = [each.config.mtu_bytes for each in self._channel.medium.radios]
        fits: NDArray[np.bool_] = packets.length_bytes <= mtu_bytes[packets.tx]
        return packets.at(fits), packets.at(~fits)

    def _too_long_rows(self, packets: Packets) -> Columns:
        """A row for each receiver; one for all of them if the packet is for all, and all nodes are on the network."""
        is_one = (packets.to == EVERYBODY) & self._places.are_same
        several = packets.at(~is_one)
        row, rx = self._channel.medium.addressees.links(self._places.on_the_network(several))
        packets = Packets.joined([packets.at(is_one), several.at(row)])
        rx = np.append(np.full(np.count_nonzero(is_one), len(self._sent.nodes)), self._places.of_all[rx])
        return {
            "sim_time_ns": packets.sim_time_ns,
            "tx": packets.tx,
            "rx": rx,
            "seq": packets.seq,
            "packets": np.ones(packets.size, dtype=np.int32),
            "length_bytes": packets.length_bytes.astype(np.int32),
            **dict.fromkeys(FIGURES, np.full(packets.size, math.nan)),
            "fate": np.full(packets.size, TOO_LONG),
            "received_ns": self._sent.facts.received_ns(packets.seq, packets.tx),
            **dict.fromkeys(INSTANTS, np.full(packets.size, NEVER_NS)),
            "attempts": np.zeros(packets.size, dtype=np.int32),
        }

    def _book(self, rows: Columns) -> None:
        """Book out, and lost at once, what no channel had to do with."""
        names = (*self._sent.nodes, None)
        columns = (rows[name].tolist() for name in ("tx", "rx", "fate", "packets"))
        for tx, rx, fate, count in zip(*columns, strict=True):
            self._ledger.lose(self._sent.nodes[tx], FATES[fate], count, names[rx])


def decide_all(networks: Sequence[NetworkAnew], on_done: OnDone) -> None:
    """Decide the packets of all networks of a run, in step: those in one band live on one clock.

    Raises:
        LedgerError: sent is not delivered plus lost: a defect of ours.
    """
    for _ in zip_longest(*(network.steps(on_done) for network in networks)):
        pass


def _stretch_of(packets: Packets, tick_period_ns: int) -> NDArray[np.int64]:
    """The tick at which each packet is to be with its network: an agent's enters after it, a modem's during it."""
    tick_ns = tick_of(packets.sim_time_ns, tick_period_ns)
    began_ns = packets.sim_time_ns // tick_period_ns * tick_period_ns
    return np.maximum.accumulate(np.where(packets.seq >= FIRST_EXACT, began_ns, tick_ns))
