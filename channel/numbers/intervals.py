"""Binomial intervals: of a count given its probability, and of a probability given a count."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from channel import checks
from channel.checks import FloatArray
from channel.numbers import special

CONFIDENCE = 0.99


def binomial_interval(
    trials: ArrayLike, probability: ArrayLike, confidence: float = CONFIDENCE
) -> tuple[FloatArray, FloatArray]:
    """Return the interval in which k/n lies with at least `confidence`, for k ~ Binomial(n, p).

    Args:
        trials: n >= 1, any shape.
        probability: p in [0, 1], broadcasts.
        confidence: two-sided, in (0, 1); each tail gets half of the rest.

    Returns:
        Lowest and highest ratio k/n of the interval, both inside it.

    Raises:
        ChannelInputError: a value out of range.
    """
    n = checks.finite("trials", trials, 1.0)
    p = checks.finite("probability", probability, 0.0, 1.0)
    tail = (1.0 - float(checks.finite("confidence", confidence, 0.0, 1.0, low_open=True))) / 2.0
    checks.broadcast(trials=n, probability=p)
    return _quantile(n, p, tail) / n, _quantile(n, p, 1.0 - tail) / n


def _quantile(n: FloatArray, p: FloatArray, level: float) -> FloatArray:
    """Return the smallest k with P(K <= k) >= level, by bisection."""
    n, p = np.broadcast_arrays(n, p)
    low, high = np.full(n.shape, -1.0), n.astype(np.float64)
    while np.any(high - low > 1.0):
        middle = np.floor((low + high) / 2.0)
        enough = (special.bdtr(np.maximum(middle, 0.0), n.astype(np.int64), p) >= level) & (middle >= 0.0)
        low, high = np.where(enough, low, np.minimum(middle, high - 1.0)), np.where(enough, middle, high)
    return high


def proportion_interval(
    successes: ArrayLike, trials: ArrayLike, confidence: float = CONFIDENCE
) -> tuple[FloatArray, FloatArray]:
    """Return the Clopper-Pearson interval of a probability of which k of n trials are known.

    Clopper & Pearson, Biometrika 26 (1934); by the incomplete beta function.

    Raises:
        ChannelInputError: a value out of range, or more successes than trials.
    """
    n = checks.finite("trials", trials, 1.0)
    k = checks.finite("successes", successes, 0.0)
    checks.broadcast(trials=n, successes=k)
    if np.any(k > n):
        raise checks.ChannelInputError("successes", float(np.max(k - n)), "at most the trials")
    tail = (1.0 - float(checks.finite("confidence", confidence, 0.0, 1.0, low_open=True))) / 2.0
    low = np.where(k > 0.0, special.betaincinv(np.maximum(k, 1.0), n - k + 1.0, tail), 0.0)
    high = np.where(k < n, special.betaincinv(k + 1.0, np.maximum(n - k, 1.0), 1.0 - tail), 1.0)
    return low, high
