"""The fates of all packets of a tick at all their receivers: links as columns, in pieces, by kinds of radios.

One draw call per stream and one error-model call serve all links of a piece between two kinds of radios.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.draws import LinkDraws, Purpose
from channel.link.radio import Radio
from channel.link.tables.lengths import Lengths
from channel.medium.addressees import Addressees
from channel.medium.judge.taken import Witness
from channel.medium.links import Indices, LinksOfPass
from channel.medium.pair import Pair, SettledLinks, blank, put
from channel.medium.reception import PARTITIONED, RADIO_OFF, Packets, Receptions
from channel.medium.stations.emitter_tracks import EmitterTracks
from channel.medium.stations.partitions import Partitions
from channel.medium.stations.switches import Switches
from channel.medium.stations.tracks import Snapshot, Tracks

LINKS_AT_ONCE = 8192
"""Links of one piece, so that its arrays stay in the processor's cache; changes no result."""


class Settling:
    """Draws fates for one radio channel.

    Args:
        radios: of each node.
        draws: of the run's links.
        tracks: where the nodes are.
        cull: whether to leave out draws that cannot change a fate.
        judge: takes in what is drawn, for a verdict.
        emitters: where the run's emitters are.
        switches: of the nodes' radios; all stay on unless given.
        partitions: of the nodes; none unless given.
        bases: which nodes stand on the ground; none unless given.
        addressees: who packets are for; nodes and everybody unless given.
        expects: whether to say how likely each delivery was; else that is NaN.

    Raises:
        ChannelInputError: radios on several frequencies.
    """

    def __init__(
        self,
        radios: Sequence[Radio],
        draws: LinkDraws,
        tracks: Tracks,
        *,
        cull: bool = True,
        judge: Witness | None = None,
        emitters: EmitterTracks | None = None,
        switches: Switches | None = None,
        partitions: Partitions | None = None,
        bases: NDArray[np.bool_] | None = None,
        addressees: Addressees | None = None,
        expects: bool = True,
    ) -> None:
        self._draws = draws
        self._tracks = tracks
        self._judge = judge
        self._kinds: list[Radio] = []
        self._kind = np.array([self._kind_of(radio) for radio in radios], dtype=np.intp)
        quietest_dbm = min((radio.noise_floor_dbm for radio in radios), default=0.0)
        self._pairs = [
            Pair(
                here.towards(there).beside(quietest_dbm),
                draws,
                tracks,
                cull=cull,
                judge=judge,
                expects=expects,
            )
            for here in self._kinds
            for there in self._kinds
        ]
        heard = {each.name for pair in self._pairs for each in pair.radio.emitters}
        self._emitters = emitters if heard else None
        self._attitude = any(pair.radio.needs_attitude for pair in self._pairs)
        self._velocity = any(pair.terms.needs_velocity for pair in self._pairs)
        count = len(draws.nodes)
        self._switches = switches or Switches(count)
        self._partitions = partitions or Partitions(draws.nodes)
        self._bases = np.zeros(count, dtype=bool) if bases is None else bases
        self._roles = any(pair.radio.needs_roles for pair in self._pairs)
        self._addressees = addressees or Addressees(draws.nodes)

    def _kind_of(self, radio: Radio) -> int:
        """Return the number of a radio; nodes with equal ones share it."""
        for number, known in enumerate(self._kinds):
            if known is radio or known.config == radio.config:
                return number
        self._kinds.append(radio)
        return len(self._kinds) - 1

    def radio(self, tx: int, rx: int) -> Radio:
        """Return the radio of links from one node to another (`Radio.towards`)."""
        pair: Pair = self._pairs[int(self._kind[tx] * len(self._kinds) + self._kind[rx])]
        return pair.radio

    @property
    def slots_ns(self) -> tuple[int, ...]:
        """Lengths of the slots in which sources of interference are on or off."""
        sources = (source for pair in self._pairs for source in pair.radio.sources)
        return tuple(sorted({source.slot_ns for source in sources if 0.0 < source.duty < 1.0}))

    @property
    def has_sources(self) -> bool:
        """Whether anything interferes."""
        return any(pair.radio.sources for pair in self._pairs)

    def erasure_draws(self, packets: Packets, packet: Indices, rx: Indices) -> FloatArray:
        """Return the numbers in (0, 1) that decide whether the error model loses packets, shape (L,)."""
        uniforms = self._draws.uniforms((Purpose.ERASURE,), (packets.tx, packets.seq), packet, rx)
        return np.asarray(uniforms[0])

    def counted_bytes(self, packets: Packets) -> NDArray[np.int64]:
        """Return the lengths of packets as the error model of their transmitter counts them, shape (P,)."""
        payloads = packets.length_bytes
        if payloads.size == 1:
            return np.array([self._kinds[self._kind[packets.tx[0]]].length_bytes(int(payloads[0]))])
        if len(self._kinds) == 1 and np.count_nonzero(payloads == payloads[:1]) == payloads.size > 0:
            return np.full(payloads.size, self._kinds[0].length_bytes(int(payloads[0])), dtype=np.int64)
        rows = list(zip(self._kind[packets.tx].tolist(), payloads.tolist(), strict=True))
        counted = {row: self._kinds[row[0]].length_bytes(row[1]) for row in set(rows)}
        return np.array([counted[row] for row in rows], dtype=np.int64)

    def receptions(self, packets: Packets, counted: NDArray[np.int64] | None = None) -> Receptions:
        """Return what becomes of packets, which are in canonical order, at all their receivers.

        Args:
            packets: the packets.
            counted: their lengths for the error model; as it counts them unless given.
        """
        packet, rx = self._addressees.links(packets)
        counted = self.counted_bytes(packets) if counted is None else counted
        if not (self._switches.are_used or self._partitions.are_used):
            return Receptions(packets, packet, rx, *self._settled(packets, counted, packet, rx))
        off = self._off(packets, packet, rx)
        apart = self._partitions.between(packets.tx[packet], rx, packets.sim_time_ns[packet])
        out, on = blank(rx.size), np.flatnonzero(~(off | apart))
        out.fate[:], out.probability_of_delivery[:] = np.where(off, RADIO_OFF, PARTITIONED), 0.0
        put(self._settled(packets, counted, packet[on], rx[on]), out, on)
        return Receptions(packets, packet, rx, *out)

    def _off(self, packets: Packets, packet: Indices, rx: Indices) -> NDArray[np.bool_]:
        """Return which links have an end whose radio is off when the packet is sent, shape (L,)."""
        when_ns = packets.sim_time_ns
        return self._switches.off(packets.tx, when_ns)[packet] | self._switches.off(rx, when_ns[packet])

    def _settled(
        self, packets: Packets, counted: NDArray[np.int64], packet: Indices, rx: Indices
    ) -> SettledLinks:
        """Return what becomes of links, in pieces."""
        if rx.size <= LINKS_AT_ONCE:
            return self._pass(packets, counted, packet, rx) if rx.size else blank(0)
        out = blank(rx.size)
        for rows, part in _passes(packet):
            settled = self._pass(packets.at(rows), counted[rows], packet[part] - rows.start, rx[part])
            put(settled, out, part)
        return out

    def _pass(
        self, packets: Packets, counted: NDArray[np.int64], packet: Indices, rx: Indices
    ) -> SettledLinks:
        """Return what becomes of links, those between each two kinds of radios together."""
        links, lengths = self._placed(packets, packet, rx), Lengths.of(counted, packet)
        if self._judge is not None:
            self._judge.begin(links)
        if len(self._pairs) == 1:
            return self._pairs[0].settled(links, lengths)
        out = blank(rx.size)
        kind = self._kind[links.tx] * len(self._kinds) + self._kind[links.rx]
        for number in np.flatnonzero(np.bincount(kind)).tolist():
            some = np.flatnonzero(kind == number)
            settled = self._pairs[number].settled(self._at(links, some, number), lengths.at(some))
            put(settled, out, some)
        return out

    def _at(self, links: LinksOfPass, some: Indices, number: int) -> LinksOfPass:
        """Return some of the links, no shorter than their pair of radios counts them."""
        these = links.at(some)
        least_m = self._pairs[number].radio.config.min_distance_m
        return these._replace(path=these.path._replace(distance_m=np.maximum(these.distance_m, least_m)))

    def _placed(self, packets: Packets, packet: Indices, rx: Indices) -> LinksOfPass:
        """Return links with the geometry of their packets' instants."""
        times, tx = packets.sim_time_ns, packets.tx[packet]
        wanted = {"attitude": self._attitude, "velocity": self._velocity}
        if times[0] == times[-1]:
            links = self._between(self._tracks.at(times[:1], **wanted), tx, rx, packets, packet, tx, rx)
            return self._with_emitters(links, times[:1], None)
        new = times[1:] != times[:-1]
        instant = np.concatenate(([0], new.cumsum()))
        instants_ns = times[np.concatenate(([True], new))]
        nodes = self._tracks.at(instants_ns, **wanted)
        base = (instant * len(self._draws.nodes))[packet]
        links = self._between(nodes, base + tx, base + rx, packets, packet, tx, rx)
        return self._with_emitters(links, instants_ns, instant[packet])

    def _with_emitters(
        self, links: LinksOfPass, instants_ns: NDArray[np.int64], instant: Indices | None
    ) -> LinksOfPass:
        """Return links with the places of the emitters; `instant` is each link's among the instants, if several."""
        if self._emitters is None:
            return links
        places = self._emitters.at(instants_ns, instant)
        return links._replace(path=links.path._replace(emitters_ned_m=places))

    def _between(
        self, nodes: Snapshot, here: Indices, there: Indices, packets: Packets, *ends: Indices
    ) -> LinksOfPass:
        """Return links between columns of a snapshot."""
        start, end = (nodes.position_ned_m.take(each, axis=1) for each in (here, there))
        way = end - start
        way *= way
        distance_m = np.sqrt(way[0] + way[1] + way[2])
        attitudes = _of_ends(nodes.attitude_wxyz, here, there)
        path = self._kinds[0].paths.of(start.T, end.T, distance_m, *attitudes)
        packet, tx, rx = ends
        if self._roles:
            path = path._replace(tx_is_base=self._bases[tx], rx_is_base=self._bases[rx])
        return LinksOfPass(
            packets, packet, tx, rx, path, distance_m, *_of_ends(nodes.velocity_ned_mps, here, there)
        )


def _passes(packet: Indices) -> Iterator[tuple[slice, slice]]:
    """Yield rows of packets and of their links in pieces of a good size, whole packets each."""
    start = 0
    while start < packet.size:
        first = int(packet[start])
        last = int(packet[min(start + LINKS_AT_ONCE, packet.size - 1)])
        row = max(last, first + 1) if start + LINKS_AT_ONCE < packet.size else last + 1
        stop = int(np.searchsorted(packet, row))
        yield slice(first, row), slice(start, stop)
        start = stop


def _of_ends(
    columns: FloatArray | None, here: Indices, there: Indices
) -> tuple[FloatArray | None, FloatArray | None]:
    """Return what a snapshot says of both ends, shape (L, ...)."""
    if columns is None:
        return None, None
    return columns.take(here, axis=1).T, columns.take(there, axis=1).T
