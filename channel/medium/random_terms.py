"""The random terms of many links at once, each from its own stream of draws.

`RandomTerms.gain_db` is the one place where shadowing, fading and the line of sight enter: it takes links as columns
(indices of both ends, sequence numbers, sim times, positions and velocities of shape (L, 3)) and the per-packet draws,
and returns what they do to the received power, dB. A law that is drawn anew for each packet is a function of these
draws; one that lasts over time or place is a field over both, see `channel.fading.terms`.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.draws import LinkDraws, Purpose
from channel.fading.link_words import LinkWords
from channel.fading.shadowing import standard_normal_from_uniform
from channel.fading.terms import LastingFading, LastingShadowing, LineOfSight
from channel.fading.waves import link_places
from channel.geometry import Path
from channel.link.emitters.emitter import slot_uniform
from channel.link.emitters.identity import interferer_names
from channel.link.radio import Radio
from channel.medium.links import Indices, LinksOfPass

LEVEL = np.zeros(())


class Lasting(NamedTuple):
    """Terms of links that last over time or place, shape (L,) each; None: the radio has none such."""

    shadow_normal: FloatArray | None = None
    sight_normal: FloatArray | None = None
    fading_gain_db: FloatArray | None = None


NOTHING = Lasting()


class RandomTerms:
    """Draws of one radio in one run.

    Args:
        radio: the radio.
        draws: of the run's links.
        fields: purpose of the words that keep the fields of links apart.

    Attributes:
        purposes: draws of each packet that `gain_db` wants, the decision about its erasure first.
        needs_velocity: whether `gain_db` asks for the velocities of the ends.
    """

    def __init__(self, radio: Radio, draws: LinkDraws, fields: str = "fields") -> None:
        config = radio.config
        self._config = config
        self._draws = draws
        self._interferers, self._emitters = interferer_names(config), radio.emitters
        self._sight = radio.sight
        run = draws.draws
        self._fields = LinkWords(run.seed, draws.nodes, fields)
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
        self._slot: Indices | None = None

    @property
    def max_gain_db(self) -> float:
        """The largest gain that any draw can give, dB; inf if a law has no bound, or the line of sight is drawn."""
        if self._sight is not None:
            return inf
        shadowing, fading = self._config.shadowing, self._config.fading
        largest = [getattr(law, "max_gain_db", inf) for law in (shadowing, fading) if law.is_random]
        return float(sum(largest))

    def gain_db(self, links: LinksOfPass, uniform: Mapping[Purpose, FloatArray]) -> FloatArray | float:
        """Return what shadowing, fading and the line of sight do to the power, shape (L,) or one number for all, dB.

        Args:
            links: the links.
            uniform: the draws for `purposes`, shape (L,) each.
        """
        lasting = self._lasting(links) if self._lasts else NOTHING
        normal = lasting.shadow_normal
        if self._shadowed:
            normal = standard_normal_from_uniform(uniform[Purpose.SHADOWING])
        gain_db: FloatArray | float = 0.0
        if self._sight is not None and lasting.sight_normal is not None:
            gain_db = -self._sight.loss_db(links.path, lasting.sight_normal, normal)
        elif normal is not None:
            gain_db = -self._config.shadowing.loss_db(normal)
        if self._faded:
            first, second = uniform[Purpose.FADING_I], uniform[Purpose.FADING_Q]
            gain_db = gain_db + self._config.fading.gain_db(first, second, self._elevation(links))
        elif lasting.fading_gain_db is not None:
            gain_db = gain_db + lasting.fading_gain_db
        return gain_db

    def _lasting(self, links: LinksOfPass) -> Lasting:
        """Return the terms that last: both directions of a pair share them at an instant, so they are made once."""
        which = None
        if links.packets.size > 1 and links.packets.sim_time_ns[0] == links.packets.sim_time_ns[-1]:
            once, which = self._pairs(links)
            links = _ends_at(links, once)
        path = links.path
        assert path.position_tx_ned_m is not None
        assert path.position_rx_ned_m is not None
        ends = path.position_tx_ned_m, path.position_rx_ned_m
        places = link_places(self._fields, links.tx, links.rx, *ends, links.sim_time_ns)
        shadow = None if self._shadowing is None else self._shadowing.standard_normal(places, path.distance_m)
        sight = None if self._states is None else self._states.standard_normal(places, path.distance_m)
        fading = None
        if self._fading is not None:
            speed_mps = _relative_speed_mps(links) if self.needs_velocity else LEVEL
            elevation = self._elevation(links)
            fading = self._fading.gain_db(places, links.sim_time_ns, path.distance_m, speed_mps, elevation)
        if which is None:
            return Lasting(shadow, sight, fading)
        return Lasting(*(None if each is None else each.take(which) for each in (shadow, sight, fading)))

    def _pairs(self, links: LinksOfPass) -> tuple[Indices, Indices]:
        """Return one link of each pair, and for each link the place of its pair's among these."""
        low, high = self._draws.by_name(links.tx, links.rx)
        if self._slot is None:
            self._slot = np.empty(len(self._draws.nodes) ** 2, dtype=np.intp)
        pair = low * len(self._draws.nodes) + high
        rows = np.arange(pair.size)
        self._slot[pair] = rows  # of several links the last one stays
        kept = self._slot[pair]
        once = np.flatnonzero(kept == rows)
        self._slot[pair[once]] = np.arange(once.size)
        return once, self._slot[pair]

    def _elevation(self, links: LinksOfPass) -> FloatArray:
        return links.path.elevation_deg if self._config.fading.by_elevation else LEVEL

    def interferers_on(self, links: LinksOfPass) -> tuple[bool | NDArray[np.bool_], ...]:
        """Return which interferers, then emitters, transmit, each for all or by link.

        The same for every receiver, on all networks of the run.
        """
        run, times_ns = self._draws.draws, links.packets.sim_time_ns
        interferers = tuple(
            each.duty >= 1.0
            or (slot_uniform(run.common, (name, "slots"), each.slot_ns, times_ns) < each.duty)[links.packet]
            for name, each in zip(self._interferers, self._config.interference.interferers, strict=True)
        )
        emitters = tuple(
            each.is_on(run.common, times_ns)[links.packet] if each.is_pulsed else each.duty > 0.0
            for each in self._emitters
        )
        return (*interferers, *emitters)

    def burst_chances(self, links: LinksOfPass) -> FloatArray:
        """Return the probability that each link loses its packet to a burst, shape (L,)."""
        words = self._bursts.of_direction(links.tx, links.rx)
        return self._config.bursts.loss_at(words, links.sim_time_ns)


def _ends_at(links: LinksOfPass, rows: Indices) -> LinksOfPass:
    """Return some of the links, with what the terms that last ask for."""
    path = links.path
    assert path.position_tx_ned_m is not None
    assert path.position_rx_ned_m is not None
    velocities = links.velocity_tx_ned_mps, links.velocity_rx_ned_mps
    return links._replace(
        packet=links.packet[rows],
        tx=links.tx[rows],
        rx=links.rx[rows],
        path=Path(
            path.frequency_hz,
            path.distance_m[rows],
            _at(path.height_tx_m, rows),
            _at(path.height_rx_m, rows),
            path.position_tx_ned_m.T.take(rows, axis=1).T,
            path.position_rx_ned_m.T.take(rows, axis=1).T,
        ),
        velocity_tx_ned_mps=None if velocities[0] is None else velocities[0][rows],
        velocity_rx_ned_mps=None if velocities[1] is None else velocities[1][rows],
    )


def _at(column: float | FloatArray, rows: Indices) -> float | FloatArray:
    return column[rows] if isinstance(column, np.ndarray) else column


def _relative_speed_mps(links: LinksOfPass) -> FloatArray:
    assert links.velocity_tx_ned_mps is not None
    assert links.velocity_rx_ned_mps is not None
    x, y, z = (links.velocity_rx_ned_mps - links.velocity_tx_ned_mps).T
    return np.asarray(np.sqrt(x * x + y * y + z * z))
