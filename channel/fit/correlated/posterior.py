"""Integrating over parameters whose law is skew: importance sampling about a mode.

A first set of points is drawn from a t law about the mode, a second one from a t law with the weighted mean and
covariance of the first (Cappé et al., J. Comput. Graph. Statist. 13 (2004)). The points are a Sobol sequence, the same
ones each time: a fit has no seed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2, norm, qmc

from channel.checks import FloatArray

FREEDOM = 6.0
"""Degrees of freedom of the t law."""
WIDER = 1.15
"""Of the t law than the mode's curvature asks for."""
FIRST, SECOND = 48, 128
MAX_CLIMBS = 20
CLIMBED = 0.05
"""Of a log-density: the gain that a step to the top of the quadratic model still promises."""
Density = Callable[[FloatArray], float]


class WeightedSample(NamedTuple):
    """Points with weights that sum to 1, in the order in which they were drawn."""

    at: FloatArray
    weight: FloatArray

    @property
    def effective(self) -> float:
        """How many points of equal weight say as much."""
        return float(1.0 / np.sum(self.weight**2))


class Mode(NamedTuple):
    """The mode of a log-density, and the covariance that its curvature asks for."""

    at: FloatArray
    value: float
    covariance: FloatArray


def climbed(density: Density, start: FloatArray, step: FloatArray, widest: FloatArray) -> Mode:
    """Climb by quadratic models, whose differences are about a standard deviation wide: noise does not turn them.

    Args:
        density: a log-density.
        start: where to begin.
        step: of the differences, to begin with.
        widest: a move, and the standard deviation of what the density does not determine.
    """
    here, value = np.array(start), density(start)
    for _ in range(MAX_CLIMBS):
        slope, bend, best, best_value = _differences(density, here, step, value)
        covariance = _inverse(bend, widest)
        step = np.clip(0.7 * np.sqrt(np.diag(covariance)), 0.2 * step, 3.0 * step)
        move = covariance @ slope
        gain = 0.5 * float(slope @ move)
        move = move / max(1.0, float(np.max(np.abs(move) / widest)))
        for share in (1.0, 0.4, 0.15):
            ahead = density(here + share * move)
            if ahead > best_value:
                best, best_value = here + share * move, ahead
                break
        if best_value <= value:
            break
        here, value = best, best_value
        if gain < CLIMBED:
            break
    return Mode(here, value, covariance)


def _differences(
    density: Density, at: FloatArray, step: FloatArray, value: float
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return slope and minus the second derivatives by central differences; and the highest point met."""
    size = at.size
    shifts = np.diag(step)
    met = {}

    def there(shift: FloatArray) -> float:
        met[tuple(at + shift)] = out = density(at + shift)
        return out

    ahead = np.array([there(shift) for shift in shifts])
    behind = np.array([there(-shift) for shift in shifts])
    bend = np.diag(2.0 * value - ahead - behind)
    for i in range(size):
        for j in range(i):
            mixed = there(shifts[i] + shifts[j]) + there(-shifts[i] - shifts[j]) + 2.0 * value
            bend[i, j] = bend[j, i] = -0.5 * (mixed - ahead[i] - ahead[j] - behind[i] - behind[j])
    best = max(met, key=lambda place: met[place])
    return (ahead - behind) / (2.0 * step), bend / np.outer(step, step), np.array(best), met[best]


def _inverse(bend: FloatArray, widest: FloatArray) -> FloatArray:
    """Return the inverse of a bend, made positive, and no wider than `widest` in any coordinate."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(bend), 1.0 / widest**2))
    values, vectors = np.linalg.eigh(bend * np.outer(scale, scale))
    inverse = (vectors / np.maximum(values, 0.02)) @ vectors.T
    return np.asarray(inverse * np.outer(scale, scale))


def sample(density: Density, top: Mode) -> WeightedSample:
    """Return weighted points of a density."""
    first = _weighted(*_drawn(density, top.at, top.covariance, FIRST, 0))
    mean = first.weight @ first.at
    apart = first.at - mean
    share = min(first.effective / 40.0, 1.0)
    covariance = share * (apart.T @ (first.weight[:, np.newaxis] * apart)) + (1.0 - share) * top.covariance
    return _weighted(*_drawn(density, share * mean + (1.0 - share) * top.at, covariance, SECOND, FIRST))


def _drawn(
    density: Density, centre: FloatArray, covariance: FloatArray, count: int, skip: int
) -> tuple[FloatArray, FloatArray]:
    """Return points of a t law, and the log of density over law at each."""
    size = centre.size
    sequence = qmc.Sobol(size + 1, scramble=False)
    sequence.fast_forward(1 + skip)
    uniform = sequence.random(count)
    radius = np.sqrt(FREEDOM / chi2.ppf(uniform[:, -1], FREEDOM)) * WIDER
    unit = norm.ppf(uniform[:, :-1]) * radius[:, np.newaxis]
    points = centre + unit @ np.linalg.cholesky(covariance).T
    law = -0.5 * (FREEDOM + size) * np.log1p(np.sum(unit**2, axis=1) / WIDER**2 / FREEDOM)
    return points, np.array([density(point) for point in points]) - law


def _weighted(points: FloatArray, logs: FloatArray) -> WeightedSample:
    weight = np.exp(logs - np.max(logs))
    return WeightedSample(points, weight / np.sum(weight))


def quantile(values: FloatArray, weight: FloatArray, level: float) -> float:
    """Return a quantile of weighted values, linear between them."""
    order = np.argsort(values, kind="stable")
    share = np.cumsum(weight[order]) - 0.5 * weight[order]
    return float(np.interp(level, share, values[order]))


def mixture_quantile(mean: FloatArray, deviation: FloatArray, weight: FloatArray, level: float) -> float:
    """Return a quantile of a weighted mixture of normal laws, by bisection."""
    low = float(np.min(mean - 12.0 * deviation))
    high = float(np.max(mean + 12.0 * deviation))
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = float(weight @ norm.cdf((middle - mean) / deviation))
        low, high = (middle, high) if below < level else (low, middle)
    return 0.5 * (low + high)
