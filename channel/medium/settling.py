"""The fates of all packets of a tick at all their receivers, in one pass over arrays of links.

One draw call per stream and one error-model call serve all links of a pass. Where the packet error rate is 1 for
certain, because even the largest gain that a draw can give leaves the SNR too low or the receiver is out of range, the
terms of the signal are not drawn: the fate is the same as with them.
"""

from __future__ import annotations

import math
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
    """

    def __init__(self, radio: Radio, draws: LinkDraws, tracks: Tracks, *, cull: bool = True) -> None:
        self._radio = radio
        self._draws = draws
        self._tracks = tracks
        self._cull = cull
        self._terms = RandomTerms(radio, draws)
        self._least_dbm = radio.noise_floor_dbm - self._terms.max_gain_db - MARGIN_DB
        self._has_range = math.isfinite(radio.max_range_m)
        self._has_interferers = bool(radio.config.interference.interferers)
        self._has_bursts = radio.config.bursts.mean_loss > 0.0
        count = len(draws.nodes)
        nodes = np.arange(max(count - 1, 0))
        self._others = nodes + (nodes >= np.arange(count)[:, np.newaxis])

    def counted_bytes(self, packets: Packets) -> NDArray[np.int64]:
        """Return the lengths of packets as the error model counts them, shape (P,)."""
        payloads = packets.length_bytes
        counted = {payload: self._radio.length_bytes(payload) for payload in set(payloads.tolist())}
        return np.array([counted[payload] for payload in payloads.tolist()], dtype=np.int64)

    def receptions(self, packets: Packets) -> Receptions:
        """Return what becomes of packets, which are in canonical order, at all their receivers."""
        packet, rx = self._links(packets)
        counted = self.counted_bytes(packets)
        if rx.size <= LINKS_AT_ONCE:
            settled = self._pass(packets, counted, packet, rx) if rx.size else _blank(0)
            return Receptions(packets, packet, rx, *settled)
        out = _blank(rx.size)
        for rows, part in _passes(packet):
            settled = self._pass(packets.at(rows), counted[rows], packet[part] - rows.start, rx[part])
            _put(settled, out, part)
        return Receptions(packets, packet, rx, *out)

    def _links(self, packets: Packets) -> tuple[Indices, Indices]:
        """Return the row of the packet and the receiver of each link."""
        rows, others = np.arange(packets.size), self._others.shape[1]
        one = packets.to != EVERYBODY
        addressed = np.count_nonzero(one)
        if not addressed:
            return rows.repeat(others), self._others[packets.tx].reshape(-1)
        if addressed == packets.size:
            return rows, packets.to
        packet = rows.repeat(np.where(one, 1, others))
        rx = np.empty_like(packet)
        to_one = one[packet]
        rx[to_one], rx[~to_one] = packets.to[one], self._others[packets.tx[~one]].reshape(-1)
        return packet, rx

    def _pass(self, packets: Packets, counted: NDArray[np.int64], packet: Indices, rx: Indices) -> Settled:
        return self._settled(self._placed(packets, packet, rx), Lengths.of(counted, packet))

    def _placed(self, packets: Packets, packet: Indices, rx: Indices) -> Links:
        """Return links with the geometry of their packets' instants."""
        times, tx = packets.sim_time_ns, packets.tx[packet]
        wanted = {"attitude": self._radio.needs_attitude, "velocity": self._terms.needs_velocity}
        if times[0] == times[-1]:
            return self._between(self._tracks.at(times[:1], **wanted), tx, rx, packets, packet, tx, rx)
        new = times[1:] != times[:-1]
        instant = np.concatenate(([0], new.cumsum()))
        nodes = self._tracks.at(times[np.concatenate(([True], new))], **wanted)
        base = (instant * len(self._draws.nodes))[packet]
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
        beyond, unknown = self._beyond(links), self._unknown(links)
        lost = self._hopeless(mean_dbm, lengths)
        for each in (beyond, unknown):
            if each is not None:
                lost |= each
        if self._cull and np.count_nonzero(lost):
            settled = self._heard_by_some(links, lengths, mean_dbm, np.flatnonzero(~lost))
        else:
            settled = self._heard(links, lengths, mean_dbm)
        self._other_losses(settled, links)
        if beyond is not None:
            settled.fate[beyond], settled.probability_of_delivery[beyond] = OUT_OF_RANGE, 0.0
        if unknown is not None:
            settled.fate[unknown], settled.probability_of_delivery[unknown] = NO_POSITION, 0.0
            for column in (settled.distance_m, settled.received_power_dbm, settled.snr_db, settled.per):
                column[unknown] = np.nan
        return settled

    def _beyond(self, links: Links) -> NDArray[np.bool_] | None:
        """Return which links are longer than the radio's range; None if it has none."""
        return ~self._radio.in_range(links.distance_m) if self._has_range else None

    def _unknown(self, links: Links) -> NDArray[np.bool_] | None:
        """Return which links have an end that was never seen; None if there is none such."""
        if self._tracks.all_known:
            return None
        known = self._tracks.known
        return ~(known[links.tx] & known[links.rx])

    def _hopeless(self, mean_dbm: FloatArray, lengths: Lengths) -> NDArray[np.bool_]:
        """Return which links erase a packet whatever is drawn."""
        enough_dbm = self._radio.hopeless_below_db(lengths) + self._least_dbm
        return mean_dbm < enough_dbm

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
        signal = signal_of(radio, links.distance_m, power_dbm, radio.noise_dbm(path, on), lengths)
        fate = (uniform[Purpose.ERASURE] <= signal.per).astype(np.uint8)
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
            settled.fate[uniform[Purpose.BASE_LOSS] <= base_loss] = BASE_LOSS
        if self._has_bursts:
            settled.fate[uniform[Purpose.BURST] <= self._terms.burst_chances(links)] = BURST

    def _uniforms(self, links: Links, *purposes: Purpose) -> dict[Purpose, FloatArray]:
        """Return the draws of one stream."""
        packets = links.packets.tx, links.packets.seq
        draws = self._draws.uniforms(purposes, packets, links.packet, links.rx)
        return {purpose: draws[i] for i, purpose in enumerate(purposes)}


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
