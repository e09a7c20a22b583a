"""Intervals of what a fit of correlated shadowing found: from its sample, each arm a little longer."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.fit.correlated.faded import K_DB, k_db_of
from channel.fit.correlated.posterior import mixture_quantile, quantile
from channel.fit.correlated.search import BASE, DECORRELATION, FLOOR, SCATTER, SIGMA, Found

TAIL = 0.025
STRETCH = 1.15
"""Of each arm of an interval, from the median: an allowance for what is approximate in the integral and the sample."""
FADED_STRETCH = 1.5
"""More so of the scatter that fading makes: fades of neighbours are a little alike, which the law leaves out."""
LEAST_EFFECTIVE = 15.0
Ends = tuple[float, float]
OPEN: Ends = (-math.inf, math.inf)


def law_ends(found: Found, index: int, extent_m: float) -> Ends:
    """Return the interval of a parameter of the law; without ends where it was not searched."""
    if not found.free[index] or found.effective < LEAST_EFFECTIVE:
        return OPEN
    into, back = SCALES[index]
    values = into(found.laws[:, index])
    stretch = FADED_STRETCH if index == SCATTER else STRETCH
    ends = _stretched(lambda level: quantile(values, found.weight, level), stretch)
    low, high = (float(back(end)) for end in ends)
    if index == BASE and found.base_may_be_zero:
        low = 0.0
    if index == DECORRELATION:
        high = high if high < extent_m else math.inf
    return low, high


def k_ends(found: Found, step_variance: float) -> Ends:
    """Return the interval of a fading's K in dB; without an end beyond what readings can show."""
    least, most = (max(end**2 - step_variance, 0.0) for end in law_ends(found, SCATTER, math.inf))
    low, high = k_db_of(math.sqrt(most)), k_db_of(math.sqrt(least))
    return low if low > K_DB[0] else -math.inf, high if high < K_DB[-1] else math.inf


def line_ends(found: Found, part: FloatArray, known: float) -> Ends:
    """Return the interval of a sum of what is free of exponent and offset, and of what is known."""
    if found.effective < LEAST_EFFECTIVE:
        return OPEN
    mean = found.lines @ part + known
    deviation = np.sqrt(np.einsum("i,kij,j->k", part, found.covariances, part))
    return _stretched(lambda level: mixture_quantile(mean, deviation, found.weight, level))


def _stretched(quantile_at: Callable[[float], float], stretch: float = STRETCH) -> Ends:
    """Return the ends of an interval."""
    middle = quantile_at(0.5)
    low, high = (middle + stretch * (quantile_at(level) - middle) for level in (TAIL, 1.0 - TAIL))
    return low, high


def _itself(values: FloatArray | float) -> FloatArray | float:
    return values


def _root(values: FloatArray | float) -> FloatArray | float:
    return np.sqrt(values)


def _square(values: FloatArray | float) -> FloatArray | float:
    return np.square(np.maximum(values, 0.0))


SCALES: dict[int, tuple[Callable[..., Any], Callable[..., Any]]] = {
    SIGMA: (np.log, np.exp),
    DECORRELATION: (np.log, np.exp),
    SCATTER: (np.log, np.exp),
    FLOOR: (_itself, _itself),
    BASE: (_root, _square),
}
"""Where an interval is stretched, and the way back."""


def correlations_of(names: tuple[str, ...], covariance: FloatArray) -> dict[str, dict[str, float]]:
    """Return correlations by name and name."""
    deviation = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    matrix: NDArray[np.float64] = np.clip(covariance / np.outer(deviation, deviation), -1.0, 1.0)
    return {
        name: dict(zip(names, (float(value) for value in row), strict=True))
        for name, row in zip(names, matrix, strict=True)
    }
