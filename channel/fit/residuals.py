"""Whether what a fit leaves of the packets is independent: the score of each packet, times those near it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from channel.checks import FloatArray

NEIGHBOURS = 5
DEPENDENT = 1e-4
"""Chance below which packets count as dependent: one log of independent ones in ten thousand is mistaken."""


def along(place: FloatArray, link: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return packets in the order of their places, link by link."""
    return np.lexsort((np.arange(place.size), place, link))


def chance_of_independence(residual: FloatArray, order: NDArray[np.intp]) -> float:
    """Return the chance that independent residuals are at least as correlated from each to its next five in an order.

    One-sided: neighbours alike. A residual has to have mean 0 given its distance, as a score has whether or not the
    packet arrived; its variance may be anything. The sum of products of independent ones is normal about 0 with the sum
    of squared products as its variance.

    Args:
        residual: one per packet, shape (packets,).
        order: indices of packets.
    """
    ordered = residual[order]
    size = float(np.quantile(np.abs(ordered), 0.99)) * 2.0
    ordered = np.clip(ordered, -size, size)
    products = [ordered[lag:] * ordered[:-lag] for lag in range(1, min(NEIGHBOURS, ordered.size - 1) + 1)]
    total = sum(float(np.sum(each)) for each in products)
    variance = sum(float(np.sum(each**2)) for each in products)
    return float(ndtr(-total / math.sqrt(variance))) if variance > 0.0 else 1.0
