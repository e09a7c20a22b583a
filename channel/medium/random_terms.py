"""The random terms of many links at once, each from its own stream of draws.

`RandomTerms.gain_db` is the one place where shadowing, fading and the line of sight enter: it takes links as columns
(indices of both ends, sequence numbers, sim times, positions and velocities of shape (L, 3)) and the per-packet draws,
and returns what they do to the received power, dB. A law that is drawn anew for each packet is a function of these
draws; one that lasts over time or place is a field over both, see `channel.fading.terms`.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.draws import LinkDraws, Purpose, uniform_from_words
from channel.fading.link_words import LinkWords
from channel.fading.shadowing import standard_normal_from_uniform
from channel.fading.terms import LastingFading, LastingShadowing, LineOfSight
from channel.fading.waves import LinkPlaces, link_places
from channel.link.radio import Radio
from channel.medium.links import Links

LEVEL = np.zeros(())


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
        self._sight = radio.sight
        run = draws.draws
        self._fields = LinkWords(run.seed, draws.nodes, "fields")
        self._bursts = LinkWords(run.seed, draws.nodes, "bursts")
        shadowing, fading = config.shadowing, config.fading
        lasting_fading = fading.is_random and fading.coherence != "packet"
        lasting_shadowing = shadowing.is_random and shadowing.decorrelation_m is not None
        self._fading = LastingFading(fading, run, config.frequency_hz) if lasting_fading else None
        self._shadowing = LastingShadowing(shadowing, run) if lasting_shadowing else None
        self._states = None if radio.sight is None else LineOfSight(run, radio.sight.decorrelation_m)
        self._lasts = any(term is not None for term in (self._fading, self._shadowing, self._states))
        self.needs_velocity = lasting_fading and fading.coherence == "block"
        self._shadowed = shadowing.is_random and not lasting_shadowing
        self._faded = fading.is_random and not lasting_fading
        shadowing_draws = (Purpose.SHADOWING,) if self._shadowed else ()
        fading_draws = (Purpose.FADING_I, Purpose.FADING_Q) if self._faded else ()
        self.purposes = (Purpose.ERASURE, *shadowing_draws, *fading_draws)

    @property
    def max_gain_db(self) -> float:
        """The largest gain that any draw can give, dB; inf if a law does not tell, or the line of sight is drawn."""
        if self._sight is not None:
            return inf
        shadowing, fading = self._config.shadowing, self._config.fading
        largest = [getattr(law, "max_gain_db", inf) for law in (shadowing, fading) if law.is_random]
        return float(sum(largest))

    def gain_db(self, links: Links, uniform: Mapping[Purpose, FloatArray]) -> FloatArray | float:
        """Return what shadowing, fading and the line of sight do to the power, shape (L,) or one number for all, dB.

        Args:
            links: the links.
            uniform: the draws for `purposes`, shape (L,) each.
        """
        places = self._places(links) if self._lasts else None
        normal = None
        if self._shadowed:
            normal = standard_normal_from_uniform(uniform[Purpose.SHADOWING])
        gain_db = self._shadowing_gain_db(links, places, normal)
        if self._faded:
            first, second = uniform[Purpose.FADING_I], uniform[Purpose.FADING_Q]
            gain_db = gain_db + self._config.fading.gain_db(first, second, self._elevation(links))
        elif self._fading is not None:
            assert places is not None
            speed_mps = _relative_speed_mps(links) if self.needs_velocity else LEVEL
            gain_db = gain_db + self._fading.gain_db(
                places, links.sim_time_ns, links.path.distance_m, speed_mps, self._elevation(links)
            )
        return gain_db

    def _places(self, links: Links) -> LinkPlaces:
        path = links.path
        assert path.position_tx_ned_m is not None
        assert path.position_rx_ned_m is not None
        ends = path.position_tx_ned_m, path.position_rx_ned_m
        return link_places(self._fields, links.tx, links.rx, *ends, links.sim_time_ns)

    def _shadowing_gain_db(
        self, links: Links, places: LinkPlaces | None, normal: FloatArray | None
    ) -> FloatArray | float:
        """Return what shadowing does, and the drawn line of sight beyond the link budget."""
        if self._shadowing is not None and places is not None:
            normal = self._shadowing.standard_normal(places, links.path.distance_m)
        if self._sight is not None and self._states is not None and places is not None:
            return -self._sight.loss_db(links.path, self._states.standard_normal(places), normal)
        return 0.0 if normal is None else -self._config.shadowing.loss_db(normal)

    def _elevation(self, links: Links) -> FloatArray:
        return links.path.elevation_deg if self._config.fading.by_elevation else LEVEL

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
        words = self._bursts.of_direction(links.tx, links.rx)
        return self._config.bursts.loss_at(words, links.sim_time_ns)


def _relative_speed_mps(links: Links) -> FloatArray:
    assert links.velocity_tx_ned_mps is not None
    assert links.velocity_rx_ned_mps is not None
    x, y, z = (links.velocity_rx_ned_mps - links.velocity_tx_ned_mps).T
    return np.asarray(np.sqrt(x * x + y * y + z * z))
