"""The random terms of the ways from emitters to sensors, by the laws that links have.

What lasts over place or time is a field over both ends, what does not is drawn by the number of the measurement: each
way depends on the seed, its two ends and its number alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.draws import LinkDraws, uniform_from_words
from channel.fading.link_words import LinkWords
from channel.fading.shadowing import standard_normal_from_uniform
from channel.fading.terms import LastingFading, LastingShadowing, LineOfSight
from channel.fading.waves import LinkPlaces, link_places
from channel.geometry import Path
from channel.link.radio import Radio
from channel.numbers import special

Indices = NDArray[np.intp]
NOISE, NOISE_REST, FADING_I, FADING_Q = range(4)
"""Words of a measurement's count."""
MEASUREMENT = ("measurement",)
SHADOWING = ("measurement shadowing",)


class Ways(NamedTuple):
    """L ways at one instant.

    Attributes:
        emitter: index among all names, shape (L,).
        sensor: likewise.
        number: of the measurement, shape (L,).
        path: geometry, from the emitter to the sensor.
        speed_mps: of one against the other, shape (L,).
    """

    emitter: Indices
    sensor: Indices
    number: NDArray[np.int64]
    path: Path
    speed_mps: FloatArray


class Gains(NamedTuple):
    """What the random terms add to the mean power, dB, and the draws of the receiver's noise; shape (L,) each."""

    shadowing_db: FloatArray
    fading_db: FloatArray
    noise_normal: FloatArray
    noise_uniform: FloatArray


class SensingTerms:
    """Draws of one kind of way in one run.

    Args:
        radio: from emitter to sensor.
        draws: of emitters and sensors.
    """

    def __init__(self, radio: Radio, draws: LinkDraws) -> None:
        shadowing, fading, run = radio.config.shadowing, radio.config.fading, draws.draws
        self._config = radio.config
        self._draws = draws
        self._sight = radio.sight
        self._words = LinkWords(run.seed, draws.nodes, "sensing")
        self._fades_anew = fading.coherence == "packet"
        self._fading: dict[float, LastingFading] = {}
        field = shadowing.is_random and shadowing.decorrelation_m is not None
        self._shadowing = LastingShadowing(shadowing, run) if field else None
        self._states = None if radio.sight is None else LineOfSight(run, radio.sight.decorrelation_m)

    def gains(self, ways: Ways, sim_time_ns: int) -> Gains:
        """Return the terms of ways at an instant."""
        words = self._draws.words(MEASUREMENT, ways.emitter, ways.sensor, ways.number)
        uniform = uniform_from_words(words)
        path = ways.path
        assert path.position_tx_ned_m is not None
        assert path.position_rx_ned_m is not None
        ends = path.position_tx_ned_m, path.position_rx_ned_m
        places = link_places(self._words, ways.emitter, ways.sensor, *ends, sim_time_ns)
        return Gains(
            self._shadowing_db(ways, places),
            self._fading_db(ways, places, uniform, sim_time_ns),
            np.asarray(special.ndtri(uniform[NOISE])),
            uniform[NOISE_REST],
        )

    def _shadowing_db(self, ways: Ways, places: LinkPlaces) -> FloatArray:
        """Return what shadowing and the line of sight add."""
        law = self._config.shadowing
        normal = None
        if self._shadowing is not None:
            normal = self._shadowing.standard_normal(places, ways.path.distance_m)
        elif law.is_random:
            words = self._draws.words(SHADOWING, ways.emitter, ways.sensor, ways.number)
            normal = standard_normal_from_uniform(uniform_from_words(words[0]))
        if self._sight is not None and self._states is not None:
            return -self._sight.loss_db(
                ways.path, self._states.standard_normal(places, ways.path.distance_m), normal
            )
        return np.zeros(len(ways.emitter)) if normal is None else -law.loss_db(normal)

    def _fading_db(self, ways: Ways, places: LinkPlaces, uniform: FloatArray, sim_time_ns: int) -> FloatArray:
        law, path = self._config.fading, ways.path
        if not law.is_random:
            return np.zeros(len(ways.emitter))
        elevation_deg = path.elevation_deg if law.by_elevation else np.zeros(())
        if self._fades_anew:
            return np.asarray(law.gain_db(uniform[FADING_I], uniform[FADING_Q], elevation_deg))
        out = np.empty(len(ways.emitter))
        carriers_hz, elevations_deg = (
            np.broadcast_to(each, out.shape) for each in (path.frequency_hz, elevation_deg)
        )
        for carrier_hz in sorted(set(carriers_hz.tolist())):
            rows = np.flatnonzero(carriers_hz == carrier_hz)
            out[rows] = self._fading_at(carrier_hz).gain_db(
                LinkPlaces(places.word[rows], places.rows[:, rows]),
                np.full(len(rows), sim_time_ns, dtype=np.int64),
                path.distance_m[rows],
                ways.speed_mps[rows],
                elevations_deg[rows],
            )
        return out

    def _fading_at(self, carrier_hz: float) -> LastingFading:
        """Return the fading that lasts of emitters on a carrier."""
        if carrier_hz not in self._fading:
            law, run = self._config.fading, self._draws.draws
            self._fading[carrier_hz] = LastingFading(law, run, carrier_hz)
        return self._fading[carrier_hz]
