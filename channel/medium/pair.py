"""What becomes of links between one kind of transmitter and one kind of receiver, as arrays over the links.

Where the packet error rate is 1 for certain, because even the largest gain that a draw can give leaves the SNR too low
or the receiver is out of range, the terms of the signal are not drawn: the fate is the same as with them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.draws import LinkDraws, Purpose
from channel.link.decision import signal_of
from channel.link.radio import Radio
from channel.link.tables.lengths import Lengths
from channel.link.tables.steps import STEPS_PER_M, STEPS_PER_ONE, in_steps
from channel.medium.interferer_terms import InterfererTerms
from channel.medium.judge.taken import Witness
from channel.medium.links import Indices, LinksOfPass
from channel.medium.random_terms import RandomTerms
from channel.medium.reception import (
    BASE_LOSS,
    BELOW_PREAMBLE,
    BURST,
    DELIVERED,
    ERASED,
    NO_POSITION,
    OUT_OF_RANGE,
)
from channel.medium.stations.tracks import Tracks

MARGIN_DB = 0.01
"""More than rounding to steps can add to an SNR."""


class SettledLinks(NamedTuple):
    """What became of L links; each of shape (L,), as in `Receptions`."""

    distance_m: FloatArray
    received_power_dbm: FloatArray
    snr_db: FloatArray
    per: FloatArray
    probability_of_delivery: FloatArray
    fate: NDArray[np.uint8]


def blank(size: int) -> SettledLinks:
    """Return columns with no numbers in them yet."""
    nan = [np.full(size, np.nan) for _ in range(5)]
    return SettledLinks(nan[0], nan[1], nan[2], nan[3], nan[4], np.zeros(size, dtype=np.uint8))


def put(settled: SettledLinks, out: SettledLinks, where: slice | Indices) -> None:
    """Put what became of some links where they belong."""
    for column, values in zip(out[:5], settled[:5], strict=True):
        column[where] = values
    out.fate[where] = settled.fate


class Pair:
    """Draws fates for links from one radio to another.

    Args:
        radio: of these links, see `Radio.towards`.
        draws: of the run's links.
        tracks: which nodes were seen.
        cull: whether to leave out draws that cannot change a fate.
        judge: takes in what is drawn, for a verdict.
        expects: whether to say how likely delivery was before anything was drawn; else that is NaN.
    """

    def __init__(
        self,
        radio: Radio,
        draws: LinkDraws,
        tracks: Tracks,
        *,
        cull: bool = True,
        judge: Witness | None = None,
        expects: bool = True,
    ) -> None:
        self.radio = radio
        self.terms = RandomTerms(radio, draws)
        self._draws = draws
        self._tracks = tracks
        self._cull = cull
        self._judge = judge
        self._expects = expects
        self._least_dbm = radio.noise_floor_dbm - self.terms.max_gain_db - MARGIN_DB
        self._has_range = math.isfinite(radio.max_range_m)
        self._has_interferers = bool(radio.sources)
        self._interferers = InterfererTerms(radio, draws) if radio.interference_varies else None
        self._has_bursts = radio.config.bursts.mean_loss > 0.0

    def settled(self, links: LinksOfPass, lengths: Lengths) -> SettledLinks:
        """Return what becomes of links: first what the signal decides, then the losses that do not depend on it."""
        mean_dbm = self.radio.mean_power_dbm(links.path)
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

    def _beyond(self, links: LinksOfPass) -> NDArray[np.bool_] | None:
        """Return which links are longer than the radio's range; None if it has none."""
        return ~self.radio.in_range(links.distance_m) if self._has_range else None

    def _unknown(self, links: LinksOfPass) -> NDArray[np.bool_] | None:
        """Return which links have an end that was never seen; None if there is none such."""
        if self._tracks.all_known:
            return None
        known = self._tracks.known
        return ~(known[links.tx] & known[links.rx])

    def _hopeless(self, mean_dbm: FloatArray, lengths: Lengths) -> NDArray[np.bool_]:
        """Return which links erase a packet whatever is drawn."""
        enough_dbm = self.radio.hopeless_below_db(lengths) + self._least_dbm
        return mean_dbm < enough_dbm

    def _heard_by_some(
        self, links: LinksOfPass, lengths: Lengths, mean_dbm: FloatArray, live: Indices
    ) -> SettledLinks:
        """Return what the signal decides if it can be heard on some of the links only."""
        none = blank(mean_dbm.size)
        none.distance_m[:] = in_steps(links.distance_m, STEPS_PER_M)
        none.per[:], none.probability_of_delivery[:], none.fate[:] = 1.0, 0.0, ERASED
        if live.size:
            heard = self._heard(links.at(live), lengths.at(live), mean_dbm[live])
            put(heard, none, live)
        return none

    def _heard(self, links: LinksOfPass, lengths: Lengths, mean_dbm: FloatArray) -> SettledLinks:
        """Return what the signal decides."""
        radio, terms, path = self.radio, self.terms, links.path
        if self._expects:
            chance = in_steps(radio.delivery_from_table(mean_dbm, path, lengths), STEPS_PER_ONE)
        else:
            chance = np.full(mean_dbm.size, np.nan)
        uniform = self._uniforms(links, *terms.purposes)
        power_dbm = mean_dbm + terms.gain_db(links, uniform)
        on = terms.interferers_on(links) if self._has_interferers else ()
        gains_db = None if self._interferers is None else self._interferers.gains_db(links)
        noise_dbm = radio.noise_dbm(path, on, gains_db)
        signal = signal_of(radio, links.distance_m, power_dbm, noise_dbm, lengths)
        fate = (uniform[Purpose.ERASURE] <= signal.per).astype(np.uint8)
        if self._judge is not None:
            self._judge.take(radio, links, mean_dbm, noise_dbm, signal, fate == ERASED)
        if radio.needs_preamble:
            fate[~radio.locks_on(signal.received_power_dbm) & (fate == DELIVERED)] = BELOW_PREAMBLE
        return SettledLinks(*signal, chance, fate)

    def _other_losses(self, settled: SettledLinks, links: LinksOfPass) -> None:
        """Put in the losses that do not depend on the signal, the later ones over the earlier."""
        base_loss = self.radio.config.base_loss
        purposes = [Purpose.BASE_LOSS] if base_loss > 0.0 else []
        purposes += [Purpose.BURST] if self._has_bursts else []
        if not purposes:
            return
        uniform = self._uniforms(links, *purposes)
        if base_loss > 0.0:
            lost = uniform[Purpose.BASE_LOSS] <= base_loss
            settled.fate[lost] = BASE_LOSS
            if self._judge is not None:
                self._judge.take_base_losses(self.radio, lost)
        if self._has_bursts:
            settled.fate[uniform[Purpose.BURST] <= self.terms.burst_chances(links)] = BURST

    def _uniforms(self, links: LinksOfPass, *purposes: Purpose) -> dict[Purpose, FloatArray]:
        """Return the draws of one stream."""
        packets = links.packets.tx, links.packets.seq
        draws = self._draws.uniforms(purposes, packets, links.packet, links.rx)
        return {purpose: draws[i] for i, purpose in enumerate(purposes)}
