"""The random terms of many links at once, each from its own stream of draws.

`RandomTerms.gain_db` is the one place where shadowing and fading enter: it takes links as columns (indices of both
ends, sequence numbers, sim times, positions and velocities of shape (L, 3)) and the per-packet draws, and returns what
they do to the received power, dB. A law that is drawn anew for each packet is a function of these draws; one that lasts
over time or place asks `LinkDraws.words` for draws of its own, keyed by the names of the ends and of its stream.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.draws import LinkDraws, Purpose, uniform_from_words
from channel.fading.laws import coherence_blocks, coherence_time_s
from channel.fading.shadow_field import ShadowField
from channel.fading.shadowing import standard_normal_from_uniform
from channel.link.radio import Radio
from channel.medium.links import Indices, Links
from channel.phy.bursts import Timelines

PairDraws = tuple[NDArray[np.int64], FloatArray]
LEVEL = np.zeros(())
FIRST_BLOCKS = -1


class RandomTerms:
    """Draws of one radio in one run.

    Args:
        radio: the radio.
        draws: of the run's links.

    Attributes:
        purposes: draws of each packet that `gain_db` wants, the decision about its erasure first.
        needs_velocity: whether `gain_db` asks for the velocities of the ends.
    """

    def __init__(self, radio: Radio, draws: LinkDraws) -> None:
        config = radio.config
        self._config = config
        self._draws = draws
        spacing_m = config.shadowing.decorrelation_m
        by_place = config.shadowing.is_random and spacing_m is not None
        self._field = ShadowField(draws, spacing_m) if by_place and spacing_m is not None else None
        self.needs_velocity = config.fading.is_random and config.fading.coherence == "doppler"
        self._shadowed = config.shadowing.is_random and not by_place
        self._faded = config.fading.is_random and not self.needs_velocity
        shadowing = (Purpose.SHADOWING,) if self._shadowed else ()
        fading = (Purpose.FADING_I, Purpose.FADING_Q) if self._faded else ()
        self.purposes = (Purpose.ERASURE, *shadowing, *fading)
        self._timelines = Timelines(draws)
        self._blocks: PairDraws | None = None

    @property
    def max_gain_db(self) -> float:
        """The largest gain that any draw can give, dB; inf if a law does not tell."""
        shadowing, fading = self._config.shadowing, self._config.fading
        largest = [getattr(law, "max_gain_db", inf) for law in (shadowing, fading) if law.is_random]
        return float(sum(largest))

    def gain_db(self, links: Links, uniform: Mapping[Purpose, FloatArray]) -> FloatArray | float:
        """Return what shadowing and fading do to the power, shape (L,) or a number for all, dB.

        Args:
            links: the links.
            uniform: the draws for `purposes`, shape (L,) each.
        """
        gain_db: FloatArray | float = 0.0
        if self._shadowed:
            normal = standard_normal_from_uniform(uniform[Purpose.SHADOWING])
            gain_db = -self._config.shadowing.loss_db(normal)
        elif self._field is not None:
            gain_db = -self._config.shadowing.loss_db(self._normal_by_place(links))
        if self._faded:
            first, second = uniform[Purpose.FADING_I], uniform[Purpose.FADING_Q]
            gain_db = gain_db + self._fading_gain_db(first, second, links)
        elif self.needs_velocity:
            first, second = self._of_blocks(links)
            gain_db = gain_db + self._fading_gain_db(first, second, links)
        return gain_db

    def _normal_by_place(self, links: Links) -> FloatArray:
        path = links.path
        assert self._field is not None
        assert path.position_tx_ned_m is not None
        assert path.position_rx_ned_m is not None
        return self._field.standard_normal(links.tx, links.rx, path.position_tx_ned_m, path.position_rx_ned_m)

    def _fading_gain_db(self, first: FloatArray, second: FloatArray, links: Links) -> FloatArray:
        fading = self._config.fading
        return fading.gain_db(first, second, links.path.elevation_deg if fading.by_elevation else LEVEL)

    def _of_blocks(self, links: Links) -> FloatArray:
        """Return two uniform draws for the block of time of each link's pair, shape (2, L): one for both directions."""
        speed_mps = _relative_speed_mps(links)
        times_s = coherence_time_s(speed_mps, links.path.frequency_hz, self._config.fading.max_coherence_s)
        octave, number = coherence_blocks(links.sim_time_ns, times_s)
        low, high = self._draws.by_name(links.tx, links.rx)
        pair = low * len(self._draws.nodes) + high
        if self._blocks is None:
            pairs = len(self._draws.nodes) ** 2
            self._blocks = np.full((2, pairs), FIRST_BLOCKS, dtype=np.int64), np.empty((2, pairs))
        block, draws = self._blocks
        wanted = np.stack((octave, number))
        other = np.flatnonzero((block[:, pair] != wanted).any(axis=0))
        return self._drawn(wanted, low, high, pair, other) if other.size else draws[:, pair]

    def _drawn(
        self, wanted: NDArray[np.int64], low: Indices, high: Indices, pair: Indices, other: Indices
    ) -> FloatArray:
        """Draw for the pairs that are in other blocks than those that are kept, and keep these."""
        assert self._blocks is not None
        block, kept = self._blocks
        draws = kept[:, pair]
        for octave in np.unique(wanted[0, other]).tolist():
            of = other[wanted[0, other] == octave]
            stream = ("fading", str(octave))
            words = self._draws.words(stream, low[of], high[of], np.maximum(wanted[1, of], 0))
            draws[:, of] = uniform_from_words(words[:2])
        block[:, pair[other]], kept[:, pair[other]] = wanted[:, other], draws[:, other]
        return draws

    def interferers_on(self, links: Links) -> tuple[bool | NDArray[np.bool_], ...]:
        """Return which interferers transmit, each True or by link: the same for every receiver."""
        interferers = self._config.interference.interferers
        return tuple(
            each.duty >= 1.0 or (self._slot_draws(i, each.slot_ns, links) < each.duty)[links.packet]
            for i, each in enumerate(interferers)
        )

    def _slot_draws(self, index: int, slot_ns: int, links: Links) -> FloatArray:
        """Return the draw of the slot that each packet falls into, shape (P,)."""
        slots, which = np.unique(np.maximum(links.packets.sim_time_ns // slot_ns, 0), return_inverse=True)
        names = ("interferer", str(index), "slots")
        words = [self._draws.draws.words(names, slot, 1)[0, 0] for slot in slots.tolist()]
        return uniform_from_words(np.array(words, dtype=np.uint64))[which]

    def burst_chances(self, links: Links) -> FloatArray:
        """Return the probability that each link loses its packet to a burst, shape (L,)."""
        return self._config.bursts.loss(self._timelines, links.tx, links.rx, links.sim_time_ns)


def _relative_speed_mps(links: Links) -> FloatArray:
    assert links.velocity_tx_ned_mps is not None
    assert links.velocity_rx_ned_mps is not None
    x, y, z = (links.velocity_rx_ned_mps - links.velocity_tx_ned_mps).T
    return np.asarray(np.sqrt(x * x + y * y + z * z))
