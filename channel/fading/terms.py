"""The random terms of links that last over time or place, as arrays over links."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.draws import Draws
from channel.fading.blocks import CLARKE, block_uniforms, coherence_time_s
from channel.fading.laws import FadingModel, scatter_gain_db
from channel.fading.place_field import CommonField, PlaceField, SharedField
from channel.fading.scatter import Scatter, Scattering
from channel.fading.shadowing import ShadowingModel
from channel.fading.waves import LinkPlaces, phasor
from channel.numbers.units import SPEED_OF_LIGHT_MPS

ENDS = slice(0, 3), slice(3, 6)
"""Rows of `LinkPlaces` with the places of both ends."""
MOST_SHARED = 0.5
"""Beyond it the shares of both ends would be more than the whole."""


class LastingFading:
    """Fading of one run that lasts: correlated by Doppler, or in blocks of time.

    Args:
        model: the law, with a coherence other than `packet`.
        draws: the run's draws.
        frequency_hz: carrier.
    """

    def __init__(self, model: FadingModel, draws: Draws, frequency_hz: float) -> None:
        self._model = model
        self._frequency_hz = frequency_hz
        self._scatter: Scatter | None = None
        if model.coherence == "doppler":
            surroundings_hz = CLARKE / model.max_coherence_s
            scattering: Scattering = getattr(model, "scattering", "ring")
            self._scatter = Scatter(draws, frequency_hz, surroundings_hz, scattering)

    def gain_db(
        self,
        places: LinkPlaces,
        sim_time_ns: NDArray[np.int64],
        distance_m: FloatArray,
        speed_mps: FloatArray,
        elevation_deg: FloatArray,
    ) -> FloatArray:
        """Return the gain of each link, dB, shape (L,).

        Args:
            places: the links.
            sim_time_ns: when the packets were sent.
            distance_m: between the ends: the phase of the direct path.
            speed_mps: relative speeds of the ends, for blocks.
            elevation_deg: for laws that depend on it; broadcasts.
        """
        if self._scatter is None:
            times_s = coherence_time_s(speed_mps, self._frequency_hz, self._model.max_coherence_s)
            return self._model.gain_db(*block_uniforms(places.word, sim_time_ns, times_s), elevation_deg)
        direct = phasor(distance_m * (self._frequency_hz / SPEED_OF_LIGHT_MPS))
        return scatter_gain_db(self._model, self._scatter.field(places), direct, elevation_deg)


class LastingShadowing:
    """Shadowing of one run that lasts over some way.

    Args:
        model: the law, with a decorrelation distance.
        draws: the run's draws.
    """

    def __init__(self, model: ShadowingModel, draws: Draws) -> None:
        spacing_m = model.decorrelation_m
        assert spacing_m is not None
        self._spacing_m = spacing_m
        self._shared = float(getattr(model, "shared_ends", 0.0))
        shared = getattr(model, "surroundings", "own") == "shared"
        self._shared_field = SharedField(draws, spacing_m, "shadow field") if shared else None
        self._own_field = PlaceField(draws, spacing_m, "shadow field")
        self._ends = CommonField(draws, spacing_m, "shadow of surroundings") if self._shared else None

    def standard_normal(self, places: LinkPlaces, distance_m: FloatArray) -> FloatArray:
        """Return z of each link, shape (L,): the law makes a loss of it.

        Args:
            places: the links.
            distance_m: between the ends, for surroundings that both have in common.
        """
        if self._ends is None:
            return self._of_both(places, distance_m)
        first, second = (self._ends.standard_normal(places.rows[end]) for end in ENDS)
        z = math.sqrt(self._shared) * (first + second)
        if self._shared < MOST_SHARED:
            z += math.sqrt(1.0 - 2.0 * self._shared) * self._of_both(places, distance_m)
        variance = 1.0 + 2.0 * self._shared * np.exp(-distance_m / self._spacing_m)
        return np.asarray(z / np.sqrt(variance))

    def _of_both(self, places: LinkPlaces, distance_m: FloatArray) -> FloatArray:
        """Return the field over the places of both ends."""
        if self._shared_field is not None:
            return self._shared_field.standard_normal(places, distance_m)
        return self._own_field.standard_normal(places)


class LineOfSight:
    """Which links have a line of sight: a state of the places of both ends, whoever stands there.

    The normal field of a link is below the quantile of the probability where there is one: TR 38.901, sec. 7.6.3.3.

    Args:
        draws: the run's draws.
        decorrelation_m: distance of either end at which the correlation has fallen to 1/e.
    """

    def __init__(self, draws: Draws, decorrelation_m: float) -> None:
        self._field = SharedField(draws, decorrelation_m, "line of sight")

    def standard_normal(self, places: LinkPlaces, distance_m: FloatArray) -> FloatArray:
        """Return the field of each link, whose ends are `distance_m` apart, shape (L,)."""
        return self._field.standard_normal(places, distance_m)
