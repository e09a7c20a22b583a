"""Random fields over the places of both ends of a link, without memory: spatially correlated shadowing, line of sight.

A sum of 48 waves (Cai & Giannakis, IEEE Trans. Veh. Technol. 52 (2003)). The wave vectors follow the Cauchy law in
three dimensions, whose characteristic function is exp(-d / d_corr): over the seeds the field has exactly Gudmundson's
autocorrelation exp(-(d_tx + d_rx) / d_corr) (Electronics Letters 27 (1991); both ends: Wang et al., VTC 2005). Along
the tracks of one run the correlation is that of its 48 waves: within 0.1 of the law, as a standard deviation. The
sum's excess kurtosis of -1.5 / 48 is taken out by the first term of Cornish and Fisher: what remains of the difference
to the normal law is of the order of 1 / 48^2.

The value depends on the places alone: not on who asked before, nor how often; both directions of a pair have one.
`SharedField` is one field for all pairs: whoever stands where another one stood finds what that one found, and two
side by side find nearly the same. `PlaceField` is one for each pair, independent of the others.
"""

from __future__ import annotations

import math

import numpy as np

from channel.checks import FloatArray
from channel.draws import Draws
from channel.fading.waves import (
    BY_PLACE,
    LinkPlaces,
    Phases,
    cosine_sum,
    multipliers,
    product_sum,
    shifted_lattice,
    wave_numbers,
)

WAVES = 48
MAX_FIELD = math.sqrt(2.0 * WAVES) * (1.0 + (2.0 * WAVES - 3.0) / (16.0 * WAVES))
"""Where all waves meet."""
FARTHEST = 8.0
"""Beyond it, one draw of 10^15, a field shared by all is cut off."""


class PlaceField:
    """Standard normal fields, one for each unordered pair of nodes.

    Args:
        draws: the run's draws.
        decorrelation_m: distance of either end at which the correlation has fallen to 1/e.
        purpose: another purpose has other fields.
    """

    def __init__(self, draws: Draws, decorrelation_m: float, purpose: str) -> None:
        points = shifted_lattice(draws, purpose, WAVES, 6)
        ends = [wave_numbers(_cauchy(points[:, k : k + 3]) / decorrelation_m) for k in (0, 3)]
        self._waves = np.concatenate((*ends, multipliers(draws, purpose, WAVES)[:, np.newaxis]), axis=1)

    def standard_normal(self, places: LinkPlaces) -> FloatArray:
        """Return the field of each link, shape (L,)."""
        return _normal(cosine_sum(places.rows[BY_PLACE], self._waves))


class SharedField:
    """One standard normal field over the places of both ends, the same for every pair and in both directions.

    (f(a, b) + f(b, a)) / sqrt(2 + 2 exp(-2 |a - b| / d_corr)): each wave with its mirror image is a product of two
    cosines, of the sum and of the difference of the places.

    Args:
        draws: the run's draws.
        decorrelation_m: distance of either end at which the correlation has fallen to 1/e.
        purpose: another purpose has another field.
    """

    def __init__(self, draws: Draws, decorrelation_m: float, purpose: str) -> None:
        points = shifted_lattice(draws, purpose, WAVES, 6)
        first, second = (_cauchy(points[:, k : k + 3]) / decorrelation_m for k in (0, 3))
        words = draws.words((purpose, "shared phases"), 0, WAVES)[:, :1] >> np.uint64(32)
        self._sum = np.concatenate((wave_numbers(0.5 * (first + second)), words.astype(np.uint32)), axis=1)
        self._difference = wave_numbers(0.5 * (first - second))
        self._decorrelation_m = decorrelation_m

    def standard_normal(self, places: LinkPlaces, distance_m: FloatArray) -> FloatArray:
        """Return the field of each link, whose ends are `distance_m` apart, shape (L,)."""
        one, other = places.rows[0:3], places.rows[3:6]
        middle = np.concatenate((one + other, np.ones((1, one.shape[1]), dtype=np.uint32)))
        near = np.exp(distance_m * (-2.0 / self._decorrelation_m))
        z = product_sum(middle, self._sum, one - other, self._difference)
        z *= (2.0 / math.sqrt(WAVES)) / np.sqrt(1.0 + near)
        kurtosis = 3.0 - 0.75 * (3.0 + near) / (1.0 + near)  # what the normal law has more, times WAVES
        z *= 1.0 + (z * z - 3.0) * (kurtosis / (24.0 * WAVES))
        return np.clip(z, -FARTHEST, FARTHEST)


class CommonField:
    """One standard normal field over all places, the same for every node.

    Args:
        draws: the run's draws.
        decorrelation_m: distance at which the correlation has fallen to 1/e.
        purpose: another purpose has another field.
    """

    def __init__(self, draws: Draws, decorrelation_m: float, purpose: str) -> None:
        waves = wave_numbers(_cauchy(shifted_lattice(draws, purpose, WAVES, 3)) / decorrelation_m)
        self._waves = np.concatenate((waves, multipliers(draws, purpose, WAVES)[:, np.newaxis]), axis=1)
        self._word = np.uint32(int(draws.words((purpose, "word"), 0, 1)[0, 0]) >> 32)

    def standard_normal(self, place: Phases) -> FloatArray:
        """Return the field at places in steps, shape (3, L) -> (L,)."""
        rows = np.concatenate((place, np.full((1, place.shape[1]), self._word)))
        return _normal(cosine_sum(rows, self._waves))


def _normal(cosines: FloatArray) -> FloatArray:
    z = cosines * math.sqrt(2.0 / WAVES)
    return z * (1.0 + (z * z - 3.0) / (16.0 * WAVES))


def _cauchy(uniform: FloatArray) -> FloatArray:
    """Return wave vectors of exp(-|x|), in turns per unit of x, for points of the unit cube, shape (..., 3).

    The length k = tan t has the distribution function 2 / pi (t - sin t cos t).
    """
    target = 0.5 * math.pi * uniform[..., 0]
    low, high = np.zeros_like(target), np.full_like(target, 0.5 * math.pi)
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = middle - np.sin(middle) * np.cos(middle) < target
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    up = 2.0 * uniform[..., 1] - 1.0
    across, azimuth = np.sqrt(1.0 - up * up), 2.0 * math.pi * uniform[..., 2]
    ways = np.stack((across * np.cos(azimuth), across * np.sin(azimuth), up), axis=-1)
    return np.asarray(np.tan(low)[..., np.newaxis] * ways / (2.0 * math.pi))
