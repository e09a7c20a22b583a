"""Expectations over the random terms of a link, by composite Gauss-Legendre quadrature."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from channel.checks import FloatArray
from channel.numbers import special

LIMIT_SIGMA = 8.3
"""The normal law beyond +-8.3 sigma weighs 1e-16: left out."""
POINTS_PER_PANEL = 8


@lru_cache(maxsize=16)
def gauss_legendre(panels: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes t in (0, 1) and weights w with the integral of f over [0, 1] = sum w f(t).

    Args:
        panels: number of equal panels, each with 8 Gauss points.
    """
    points, weights = np.polynomial.legendre.leggauss(POINTS_PER_PANEL)
    centres = (np.arange(panels) + 0.5) / panels
    nodes = (centres[:, np.newaxis] + points / (2.0 * panels)).ravel()
    return nodes, np.tile(weights / (2.0 * panels), panels)


@lru_cache(maxsize=16)
def standard_normal_rule(panels: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes z and weights w with E f(Z) = sum w f(z) for Z ~ N(0, 1).

    With an even number of panels 0 is a border between two of them: |z| costs no accuracy.
    """
    t, weights = gauss_legendre(panels)
    nodes = LIMIT_SIGMA * (2.0 * t - 1.0)
    density = np.exp(-0.5 * nodes**2) / math.sqrt(2.0 * math.pi)
    return nodes, 2.0 * LIMIT_SIGMA * weights * density


def split_normal_rule(breaks: FloatArray, panels: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights as `standard_normal_rule`, with more borders: for integrands that jump there.

    Args:
        breaks: where each integrand jumps, shape (integrands, jumps).
        panels: before the splits.

    Returns:
        Two arrays of shape (integrands, nodes).
    """
    nodes, weights = split_gauss_legendre(breaks, panels, -LIMIT_SIGMA, LIMIT_SIGMA)
    density = np.exp(-0.5 * nodes**2) / math.sqrt(2.0 * math.pi)
    return nodes, weights * density


def split_gauss_legendre(
    breaks: FloatArray, panels: int, low: float = 0.0, high: float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """Return nodes t in (low, high) and weights of integrals from there to there, with more borders at the breaks.

    Args:
        breaks: where each integrand jumps or bends, shape (integrands, breaks); those outside change nothing.
        panels: equal ones, before the splits, each with 8 Gauss points.
        low: the lower limit.
        high: the upper one.

    Returns:
        Two arrays of shape (integrands, nodes).
    """
    points, weights = np.polynomial.legendre.leggauss(POINTS_PER_PANEL)
    even = np.broadcast_to(np.linspace(low, high, panels + 1), (len(breaks), panels + 1))
    edges = np.sort(np.concatenate((even, np.clip(breaks, low, high)), axis=1), axis=1)
    half = 0.5 * np.diff(edges, axis=1)[..., np.newaxis]
    nodes = 0.5 * (edges[:, 1:] + edges[:, :-1])[..., np.newaxis] + half * points
    return nodes.reshape(len(breaks), -1), (half * weights).reshape(len(breaks), -1)


def uniform_from_normal(standard_normal: FloatArray) -> FloatArray:
    """Return the normal law's distribution function, kept inside (0, 1)."""
    return np.clip(special.ndtr(standard_normal), 1e-300, 1.0 - 2.0**-53)
