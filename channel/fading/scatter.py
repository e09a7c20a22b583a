"""Time-correlated scatter: a sum of 31 sinusoids over the ways that both ends have moved.

Clarke's model, by Jakes' sum of sinusoids: waves arrive from all around, each with a phase of its own. A wave's phase
goes with the place of each end, as in the model of Akki and Haber for two ends that move (IEEE Trans. Veh. Technol. 35
(1986)), so that along tracks at speeds v1 and v2 the autocorrelation is J0(2 pi v1 t / lambda) J0(2 pi v2 t / lambda),
however the speeds change; any instant can be computed alone, and both directions of a pair see the same. With
`scattering: sphere` waves come from above and below, too, and J0(x) becomes sin(x) / x. A slow Doppler spread of the
surroundings adds the factor J0(2 pi f t), for ends that stand still.

Directions are spread evenly (Zheng & Xiao, IEEE Trans. Commun. 51 (2003)) with a random turn, so that the time average
of one link comes near the average over the seeds. A sum of N waves has a scatter power x whose law differs from the
exponential by terms of the order of 1 / N; multiplying x by 1 - 1 / 2N + x / 4N takes these out (the expansion of its
density in Laguerre polynomials has the coefficient -1 / 2N at L2). Levels are crossed up to 2 % more often than by a
normal process: the speed at which the field changes is not quite independent of where it is. The waves are common
to all links of a run: over long ways its autocorrelation is off by 1 / sqrt(N) (rms), that of the power by up to -1 / N
in the mean.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.draws import Draws, uniform_from_words
from channel.fading.waves import (
    BY_PLACE_AND_TIME,
    LinkPlaces,
    frequencies,
    multipliers,
    phasor_sum,
    wave_numbers,
)
from channel.numbers.units import SPEED_OF_LIGHT_MPS

WAVES = 31
SECOND_END = 12
SURROUNDINGS = 7
"""Directions at the second end, and of the surroundings, take the waves in another order: n times this, modulo 31."""
GOLDEN_TURN = 0.6180339887498949

Scattering = Literal["ring", "sphere"]


class Scatter:
    """The scattered field of links: complex, mean power 1, circularly normal.

    Args:
        draws: the run's draws.
        frequency_hz: carrier.
        doppler_hz: largest Doppler shift by the surroundings.
        scattering: waves from all around at the horizon, or from the whole sphere.
    """

    def __init__(
        self, draws: Draws, frequency_hz: float, doppler_hz: float, scattering: Scattering = "ring"
    ) -> None:
        turns = uniform_from_words(draws.words(("scatter", "turns"), 0, 2).ravel())
        n = np.arange(WAVES)
        per_m = frequency_hz / SPEED_OF_LIGHT_MPS
        ends = [
            wave_numbers(per_m * _directions(n * step % WAVES, turns[k : k + 2], scattering))
            for k, step in ((0, 1), (2, SECOND_END))
        ]
        shift_hz = doppler_hz * np.cos(2.0 * math.pi * (n * SURROUNDINGS % WAVES / WAVES + turns[4]))
        others = frequencies(shift_hz), multipliers(draws, "scatter", WAVES)
        columns = np.concatenate((*ends, *(each[:, np.newaxis] for each in others)), axis=1)
        used = np.flatnonzero(columns.any(axis=0))
        self._rows = np.array(BY_PLACE_AND_TIME)[used]
        self._waves = columns[:, used]

    def field(self, places: LinkPlaces) -> NDArray[np.complex128]:
        """Return the scattered field of each link, shape (L,)."""
        waves = phasor_sum(places.rows[self._rows], self._waves)
        waves *= 1.0 / math.sqrt(WAVES)
        power = np.square(waves.real) + np.square(waves.imag)
        waves *= np.sqrt((1.0 - 0.5 / WAVES) + power * (0.25 / WAVES))
        return waves


def _directions(n: NDArray[np.intp], turn: FloatArray, scattering: Scattering) -> FloatArray:
    """Return unit vectors from which waves come, shape (waves, 3)."""
    if scattering == "ring":
        azimuth = 2.0 * math.pi * (n / WAVES + turn[0])
        return np.stack((np.cos(azimuth), np.sin(azimuth), np.zeros(len(n))), axis=-1)
    up = 2.0 * ((n / WAVES + turn[1]) % 1.0) - 1.0
    across, azimuth = np.sqrt(1.0 - up * up), 2.0 * math.pi * (n * GOLDEN_TURN + turn[0])
    return np.stack((across * np.cos(azimuth), across * np.sin(azimuth), up), axis=-1)
