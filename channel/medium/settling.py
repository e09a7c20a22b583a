"""The fates of all packets of a tick at all their receivers, in one pass over arrays of links.

One draw call per stream and one error-model call serve all links of a pass. Where the packet error rate is 1 for
certain, because even the largest gain that a draw can give leaves the SNR too low or the receiver is out of range, the
terms of the signal are not drawn: the fate is the same as with them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.draws import LinkDraws, Purpose
from channel.link.decision import signal_of
from channel.link.lengths import Lengths
from channel.link.radio import Radio
from channel.link.steps import STEPS_PER_M, STEPS_PER_ONE, in_steps
from channel.medium.links import Indices, Links
from channel.medium.random_terms import RandomTerms
from channel.medium.reception import (
    BASE_LOSS,
    BURST,
    ERASED,
    EVERYBODY,
    NO_POSITION,
    OUT_OF_RANGE,
    Packets,
    Receptions,
)
from channel.medium.tracks import Snapshot, Tracks
from channel.medium.verdict import Judge

LINKS_AT_ONCE = 8192
"""Links of one pass, so that its arrays stay in the processor's cache; changes no result."""
MARGIN_DB = 0.01
"""More than rounding to steps can add to an SNR."""


class Settled(NamedTuple):
    """What became of L links; each of shape (L,), as in `Receptions`."""

    distance_m: FloatArray
    received_power_dbm: FloatArray
    snr_db: FloatArray
    per: FloatArray
    probability_of_delivery: FloatArray
    fate: NDArray[np.uint8]


class Settling:
    """Draws fates for one radio channel.

    Args:
        radio: the same at every node.
        draws: of the run's links.
        tracks: where the nodes are.
        cull: whether to leave out draws that cannot change a fate.
        judge: takes in what was drawn, for a verdict.
    """

    def __init__(
        self,
        radio: Radio,
        draws: LinkDraws,
        tracks: Tracks,
        *,
        cull: bool = True,
        judge: Judge | None = None,
    ) -> None:
        self._radio = radio
        self._draws = draws
        self._tracks = tracks
        self._cull = cull
        self._judge = judge
        self._terms = RandomTerms(radio, draws)
        self._max_gain_db = self._terms.max_gain_db
        self._has_interferers = bool(radio.config.interference.interferers)
        self._has_bursts = radio.config.bursts.mean_loss > 0.0
        count = len(draws.nodes)
        nodes = np.arange(max(count - 1, 0))
        self._others = nodes + (nodes >= np.arange(count)[:, np.newaxis])

    def counted_bytes(self, packets: Packets) -> NDArray[np.int64]:
        """Return the lengths of packets as the error model counts them, shape (P,)."""
        payloads = packets.length_bytes.tolist()
        counted = {payload: self._radio.length_bytes(payload) for payload in set(payloads)}
        return np.array([counted[payload] for payload in payloads], dtype=np.int64)

    def receptions(self, packets: Packets) -> Receptions:
        """Return what becomes of packets, which are in canonical order, at all their receivers."""
        packet, rx = self._links(packets)
        out = _blank(rx.size)
        counted = self.counted_bytes(packets)
        for rows, part in self._passes(packets):
            links = self._placed(packets.at(rows), packet[part] - rows.start, rx[part])
            settled = self._settled(links, Lengths.of(counted[rows], links.packet))
            _put(settled, out, part)
        return Receptions(packets, packet, rx, *out)

    def _links(self, packets: Packets) -> tuple[Indices, Indices]:
        """Return the row of the packet and the receiver of each link."""
        everybody = packets.to == EVERYBODY
        counts = np.where(everybody, self._others.shape[1], 1)
        packet = np.repeat(np.arange(packets.size), counts)
        if everybody.all():
            return packet, self._others[packets.tx].ravel()
        rx = np.empty(packet.size, dtype=np.intp)
        wide = everybody[packet]
        rx[wide] = self._others[packets.tx[everybody]].ravel()
        rx[~wide] = packets.to[~everybody]
        return packet, rx

    def _passes(self, packets: Packets) -> Iterator[tuple[slice, slice]]:
        """Yield packets and their links in pieces of a good size."""
        counts = np.where(packets.to == EVERYBODY, self._others.shape[1], 1)
        ends = np.cumsum(counts)
        row, link = 0, 0
        while row < packets.size:
            stop = max(int(np.searchsorted(ends, link + LINKS_AT_ONCE, side="right")), row + 1)
            yield slice(row, stop), slice(link, int(ends[stop - 1]))
            row, link = stop, int(ends[stop - 1])

    def _placed(self, packets: Packets, packet: Indices, rx: Indices) -> Links:
        """Return links with the geometry of their packets' instants."""
        times, tx = packets.sim_time_ns, packets.tx[packet]
        first = np.flatnonzero(np.diff(times, prepend=times[0] - 1))
        needs_velocity = self._terms.needs_velocity
        nodes = self._tracks.at(times[first], attitude=self._radio.needs_attitude, velocity=needs_velocity)
        if first.size == 1:
            return self._between(nodes, tx, rx, packets, packet, tx, rx)
        instant = np.repeat(np.arange(first.size), np.diff(first, append=times.size)) * len(self._draws.nodes)
        base = instant[packet]
        return self._between(nodes, base + tx, base + rx, packets, packet, tx, rx)

    def _between(
        self, nodes: Snapshot, here: Indices, there: Indices, packets: Packets, *ends: Indices
    ) -> Links:
        """Return links between columns of a snapshot."""
        start, end = (nodes.position_ned_m.take(each, axis=1) for each in (here, there))
        way = end - start
        way *= way
        distance_m = np.sqrt(way[0] + way[1] + way[2])
        attitudes = _of_ends(nodes.attitude_wxyz, here, there)
        path = self._radio.path_of(start.T, end.T, distance_m, *attitudes)
        packet, tx, rx = ends
        return Links(
            packets, packet, tx, rx, path, distance_m, *_of_ends(nodes.velocity_ned_mps, here, there)
        )

    def _settled(self, links: Links, lengths: Lengths) -> Settled:
        """Return what becomes of links: first what the signal decides, then the losses that do not depend on it."""
        mean_dbm = self._radio.mean_power_dbm(links.path)
        beyond = links.distance_m > self._radio.max_range_m
        if beyond.any():
            beyond = ~self._radio.in_range(links.distance_m)
        known = self._tracks.known
        unknown = ~(known[links.tx] & known[links.rx])
        hopeless = self._hopeless(mean_dbm, lengths) | beyond | unknown
        if self._cull and hopeless.any():
            settled = self._heard_by_some(links, lengths, mean_dbm, np.flatnonzero(~hopeless))
        else:
            settled = self._heard(links, lengths, mean_dbm)
        self._other_losses(settled, links)
        settled.fate[beyond] = OUT_OF_RANGE
        settled.probability_of_delivery[beyond | unknown] = 0.0
        if unknown.any():
            settled.fate[unknown] = NO_POSITION
            for column in (settled.distance_m, settled.received_power_dbm, settled.snr_db, settled.per):
                column[unknown] = np.nan
        return settled

    def _hopeless(self, mean_dbm: FloatArray, lengths: Lengths) -> NDArray[np.bool_]:
        """Return which links erase a packet whatever is drawn."""
        most_db = mean_dbm + (self._max_gain_db - self._radio.noise_floor_dbm + MARGIN_DB)
        return np.less(most_db, self._radio.hopeless_below_db(lengths))

    def _heard_by_some(self, links: Links, lengths: Lengths, mean_dbm: FloatArray, live: Indices) -> Settled:
        """Return what the signal decides if it can be heard on some of the links only."""
        none = _blank(mean_dbm.size)
        none.distance_m[:] = in_steps(links.distance_m, STEPS_PER_M)
        none.per[:], none.probability_of_delivery[:], none.fate[:] = 1.0, 0.0, ERASED
        if live.size:
            heard = self._heard(links.at(live), lengths.at(live), mean_dbm[live])
            _put(heard, none, live)
        return none

    def _heard(self, links: Links, lengths: Lengths, mean_dbm: FloatArray) -> Settled:
        """Return what the signal decides."""
        radio, terms, path = self._radio, self._terms, links.path
        chance = in_steps(radio.expected_delivery(mean_dbm, path, lengths), STEPS_PER_ONE)
        uniform = self._uniforms(links, *terms.purposes)
        power_dbm = mean_dbm + terms.gain_db(links, uniform)
        on = terms.interferers_on(links) if self._has_interferers else ()
        noise_dbm = radio.noise_dbm(path, on)
        signal = signal_of(radio, links.distance_m, power_dbm, noise_dbm, lengths)
        fate = (uniform[Purpose.ERASURE] <= signal.per).astype(np.uint8)
        if self._judge is not None:
            self._judge.take(links, mean_dbm, noise_dbm, signal, fate == ERASED)
        return Settled(*signal, chance, fate)

    def _other_losses(self, settled: Settled, links: Links) -> None:
        """Put in the losses that do not depend on the signal, the later ones over the earlier."""
        base_loss = self._radio.config.base_loss
        purposes = [Purpose.BASE_LOSS] if base_loss > 0.0 else []
        purposes += [Purpose.BURST] if self._has_bursts else []
        if not purposes:
            return
        uniform = self._uniforms(links, *purposes)
        if base_loss > 0.0:
            lost = uniform[Purpose.BASE_LOSS] <= base_loss
            settled.fate[lost] = BASE_LOSS
            if self._judge is not None:
                self._judge.take_base_losses(lost)
        if self._has_bursts:
            settled.fate[uniform[Purpose.BURST] <= self._terms.burst_chances(links)] = BURST

    def _uniforms(self, links: Links, *purposes: Purpose) -> dict[Purpose, FloatArray]:
        """Return the draws of one stream."""
        packets = links.packets.tx, links.packets.seq
        draws = self._draws.uniforms(purposes, packets, links.packet, links.rx)
        return dict(zip(purposes, draws, strict=True))


def _blank(size: int) -> Settled:
    """Return columns with no numbers in them yet."""
    nan = [np.full(size, np.nan) for _ in range(5)]
    return Settled(nan[0], nan[1], nan[2], nan[3], nan[4], np.zeros(size, dtype=np.uint8))


def _put(settled: Settled, out: Settled, where: slice | Indices) -> None:
    """Put what became of some links where they belong."""
    for column, values in zip(out[:5], settled[:5], strict=True):
        column[where] = values
    out.fate[where] = settled.fate


def _of_ends(
    columns: FloatArray | None, here: Indices, there: Indices
) -> tuple[FloatArray | None, FloatArray | None]:
    """Return what a snapshot says of both ends, shape (L, ...)."""
    if columns is None:
        return None, None
    return columns.take(here, axis=1).T, columns.take(there, axis=1).T
