"""Packets of a run in, their receptions with all instants out, as columns: the side of a medium that takes time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from channel.access.media.medium import AccessMedium
from channel.access.packets import AirFate, AirFates, AirFrame, AirPacket, Handling, Loss, Outcome, Reply
from channel.medium.judge.judge import Judge
from channel.medium.medium import Medium
from channel.medium.reception import EVERYBODY, FATES, NO_PACKETS, Fate, Packets, Receptions
from channel.network.entry import EntryInstants
from channel.network.fates import FateColumns
from channel.network.instants import NEVER_NS, InstantColumns
from channel.network.link_world import LinkWorld
from channel.network.own_classes import told_by_class
from channel.own.methods import OwnModelError
from channel.routing.routed import Routed, RoutingCounts
from channel.routing.router import HopRouter

Keys = Sequence[tuple[int, int]]
"""Of packets: sender and number."""


class PacketNetwork(Protocol):
    """What takes packets and says what became of them: a medium, or one with routing over it."""

    def offer(self, packet: AirPacket) -> None:
        """Have a packet enter its sender's radio at its instant."""

    def live(self, until_ns: int) -> list[Outcome | AirFates]:
        """Let it live until an instant; what came of packets since the last call."""

    def queued(self, node: int) -> tuple[int, int]:
        """How many packets of a node wait, and their length in bytes."""

    def receivers_of(self, packet: AirPacket) -> tuple[int, ...]:
        """Who has a fate of it."""


class RadioRoute(NamedTuple):
    """The way by which a packet came, other than the one before it on the same link.

    Attributes:
        sim_time_ns: when it was sent.
        tx, rx, number: of the packet.
        arrived_ns: when it came.
        nodes: who transmitted it, from its sender on.
    """

    sim_time_ns: int
    tx: int
    rx: int
    number: int
    arrived_ns: int
    nodes: tuple[int, ...]

    def among(self, places: Sequence[int]) -> RadioRoute:
        """The same with other places of nodes."""
        nodes = tuple(places[node] for node in self.nodes)
        return self._replace(tx=places[self.tx], rx=places[self.rx], nodes=nodes)


@dataclass(frozen=True, slots=True)
class Lived:
    """What came of a stretch of time.

    Attributes:
        receptions: that were decided in it, in the order of their instants.
        instants: of these.
        replies: what senders learn of their unicasts, in order.
        done: sender and number of the packets of which now all is decided.
        first: what first transmissions met in it, alone on the air.
        routes: that changed, in the order of arrivals.
    """

    receptions: Receptions
    instants: InstantColumns
    replies: Sequence[Reply]
    done: Keys
    first: Sequence[Receptions]
    routes: Sequence[RadioRoute] = ()


@dataclass(slots=True)
class _Open:
    """A packet on its way: when its agent sent it, for whom (`Packets.to`), and whose fate is open."""

    packet: AirPacket
    sim_time_ns: int
    to: int
    receivers: set[int]


class Network:
    """One radio network of a run.

    Args:
        medium: where the nodes are, and their radios.
        open_medium: makes the medium in a world.
        entry: when packets enter their radios.
        judge: takes in what is drawn.
        router: by which nodes hand packets on; None: they do not.
    """

    def __init__(
        self,
        medium: Medium,
        open_medium: Callable[[LinkWorld], AccessMedium],
        entry: EntryInstants,
        judge: Judge | None = None,
        router: HopRouter | None = None,
    ) -> None:
        self._world = LinkWorld(medium, judge)
        self._access = open_medium(self._world)
        self._router = router
        with told_by_class(self._access, router):
            self._routed = (
                None
                if router is None
                else Routed(self._access, router, self._distance_m, self._world.apart_m)
            )
        self._packets: PacketNetwork = self._access if self._routed is None else self._routed
        self._ways: dict[tuple[int, int], tuple[int, ...]] = {}
        """Of the latest packet that came, by sender and receiver."""
        self._entry = entry
        self._addressees, self._is_alone = medium.addressees, len(medium.nodes) < 2
        self._unreached: list[AirFate] = []
        """Of packets to several, at the nodes that their sender's radio has no link to."""
        self._open: dict[tuple[int, int], _Open] = {}
        """Packets on their way, by sender and number."""
        self._for_nobody: list[tuple[int, int]] = []
        """Packets that are for no other node: of a node that is alone, or to a group without others."""
        self._came: list[AirFate | AirFates | Reply] = []
        """What came of packets, and was not asked for by `live`."""
        self._now_ns = 0

    @property
    def phases_ns(self) -> Sequence[int]:
        """Of all nodes."""
        return self._entry.phases_ns

    @property
    def world(self) -> LinkWorld:
        """What frames meet."""
        return self._world

    @property
    def access(self) -> AccessMedium:
        """Who transmits when."""
        return self._access

    @property
    def routing(self) -> RoutingCounts | None:
        """What routing cost so far; None: nodes do not hand packets on."""
        return None if self._routed is None else self._routed.counts

    def queued(self, node: int) -> tuple[int, int]:
        """How many packets of a node wait, and their length in bytes."""
        return self._packets.queued(node)

    def send(self, packets: Packets, handling: Sequence[Handling]) -> None:
        """Have packets enter their radios: in canonical order, none before the instant that `live` came to."""
        columns = (column.tolist() for column in packets)
        for (sim_time_ns, tx, seq, length_bytes, to), how in zip(
            zip(*columns, strict=True), handling, strict=True
        ):
            at_ns = max(self._entry.at_ns(tx, seq, sim_time_ns), self._now_ns)
            receiver, members = None if to < 0 else to, self._addressees.members(to)
            packet = AirPacket(tx, seq, receiver, length_bytes, at_ns, *how, members)
            self._take(packet, sim_time_ns, to)

    def _take(self, packet: AirPacket, sim_time_ns: int, to: int) -> None:
        tx, seq = packet.node, packet.number
        receivers = self._addressees.receivers(tx, to)
        others = receivers.difference(self._packets.receivers_of(packet))
        self._unreached += [
            AirFate(packet, other, packet.at_ns, NEVER_NS, NEVER_NS, 0, Loss.NO_PEER)
            for other in sorted(others)
        ]
        if receivers:
            self._open[tx, seq] = _Open(packet, sim_time_ns, to, receivers)
        else:
            self._for_nobody.append((tx, seq))
        if not self._is_alone:
            self._packets.offer(packet)

    def enter(self, packet: AirPacket) -> Sequence[int]:
        """Have a packet enter its radio at its instant, that `advance` came to.

        Returns:
            Who has a fate of it from the medium.
        """
        self._take(packet, packet.at_ns, EVERYBODY if packet.to is None else packet.to)
        return () if self._is_alone else self._packets.receivers_of(packet)

    def advance(self, until_ns: int) -> list[AirFate]:
        """Let the network live up to an instant within a stretch; what was decided, which `live` has, too."""
        outcomes = self._live(until_ns)
        self._came += outcomes
        fates = [
            one for each in outcomes for one in (each.singly() if isinstance(each, AirFates) else (each,))
        ]
        found = [each for each in fates if isinstance(each, AirFate)]
        return sorted(
            found, key=lambda fate: (fate.at_ns, fate.packet.node, fate.packet.number, fate.receiver)
        )

    def live(self, until_ns: int) -> Lived:
        """Let the network live until just before an instant; what was decided since the last call."""
        outcomes = [*self._came, *self._live(until_ns - 1)]
        self._came = []
        self._now_ns = until_ns
        fates = [outcome for outcome in outcomes if isinstance(outcome, AirFate)]
        fates += [fate for fate in self._unreached if fate.at_ns < until_ns]
        self._unreached = [fate for fate in self._unreached if fate.at_ns >= until_ns]
        together = [outcome for outcome in outcomes if isinstance(outcome, AirFates)]
        replies = [outcome for outcome in outcomes if isinstance(outcome, Reply)]
        return self._lived(fates, together, replies, self._changed_routes(fates))

    def end(self) -> Lived:
        """The run is over: what is not decided never will be."""
        fates = [
            AirFate(each.packet, rx, self._now_ns, NEVER_NS, NEVER_NS, 0, None)
            for each in self._open.values()
            for rx in sorted(each.receivers)
        ]
        lived = self._lived(fates, [], [])
        lived.receptions.fate[:] = FATES.index(Fate.RUN_ENDED)
        return lived

    def _live(self, until_ns: int) -> list[Outcome | AirFates]:
        with told_by_class(self._access, self._router):
            return self._packets.live(until_ns)

    def _distance_m(self, frame: AirFrame, node: int) -> float:
        return self._world.figures(frame, node)[0]

    def _changed_routes(self, fates: Sequence[AirFate]) -> Sequence[RadioRoute]:
        """Ways of packets that came, where they differ from those before them."""
        came = [fate for fate in fates if fate.way and fate.loss is None]
        found = []
        for fate in sorted(came, key=lambda each: (each.at_ns, each.packet.node, each.packet.number)):
            tx, rx, number = fate.packet.node, fate.receiver, fate.packet.number
            if self._ways.get((tx, rx)) != fate.way:
                self._ways[tx, rx] = fate.way
                sent_ns = self._open[tx, number].sim_time_ns
                found.append(RadioRoute(sent_ns, tx, rx, number, fate.at_ns, fate.way))
        return found

    def _lived(
        self,
        fates: Sequence[AirFate],
        together: Sequence[AirFates],
        replies: Sequence[Reply],
        routes: Sequence[RadioRoute] = (),
    ) -> Lived:
        columns = FateColumns.of(fates, together, self._world)
        packets, rows = self._packets_of(columns)
        order = np.lexsort((columns.receiver, packets.seq[rows], packets.tx[rows], columns.at_ns))
        columns, rows = columns.at(order), rows[order]
        entered_ns = np.array([packet.at_ns for packet in columns.packets], dtype=np.int64)[columns.packet]
        instants = InstantColumns(
            np.where(entered_ns < self._now_ns, entered_ns, NEVER_NS),
            columns.started_ns,
            columns.ended_ns,
            columns.at_ns,
            columns.attempts,
        )
        done = [*self._for_nobody, *self._close(packets, rows, columns.receiver)]
        self._for_nobody.clear()
        figures = columns.figures.T.copy()
        receptions = Receptions(
            packets,
            rows,
            columns.receiver,
            figures[0],
            figures[1],
            figures[2],
            figures[3],
            figures[4],
            columns.code,
        )
        return Lived(receptions, instants, replies, done, self._world.first_transmissions(), routes)

    def _close(self, packets: Packets, rows: NDArray[np.intp], receiver: NDArray[np.intp]) -> Keys:
        """Take note of what is decided, in order; the packets of which now all is."""
        last, by_packet = np.zeros(packets.size, dtype=np.intp), np.argsort(rows, kind="stable")
        last[rows] = np.arange(rows.size)
        ends = np.cumsum(np.bincount(rows, minlength=packets.size)).tolist()
        keys = list(zip(packets.tx.tolist(), packets.seq.tolist(), strict=True))
        decided = receiver[by_packet].tolist()
        done = []
        for key, begin, end, place in zip(keys, [0, *ends], ends, last.tolist(), strict=False):
            still_open = self._open[key].receivers
            left = len(still_open) - (end - begin)
            still_open.difference_update(decided[begin:end])
            if len(still_open) != left:
                raise self._told_twice(key)
            if not still_open:
                del self._open[key]
                done.append((place, key))
        return [key for _, key in sorted(done)]

    def _told_twice(self, key: tuple[int, int]) -> OwnModelError:
        node, number = key
        return OwnModelError(
            f"the medium {type(self._access).__name__} has two fates of packet {number} of node "
            f"{self._world.ids[node]} at one receiver: it is transmitted twice, or booked twice"
        )

    def _packets_of(self, columns: FateColumns) -> tuple[Packets, NDArray[np.intp]]:
        """The packets that fates are of, in canonical order, and the row of each fate's."""
        keys = [(packet.node, packet.number) for packet in columns.packets]
        for key in keys:
            if key not in self._open:
                raise self._told_twice(key)
        order = sorted((self._open[key].sim_time_ns, *key) for key in set(keys))
        if not order:
            return NO_PACKETS, np.zeros(0, dtype=np.intp)
        row_of = {(tx, seq): row for row, (_, tx, seq) in enumerate(order)}
        sent = [self._open[tx, seq] for _, tx, seq in order]
        packets = Packets(
            np.array([sim_time_ns for sim_time_ns, _, _ in order]),
            np.array([tx for _, tx, _ in order], dtype=np.intp),
            np.array([seq for _, _, seq in order]),
            np.array([each.packet.length_bytes for each in sent]),
            np.array([each.to for each in sent], dtype=np.intp),
        )
        return packets, np.array([row_of[key] for key in keys], dtype=np.intp)[columns.packet]
