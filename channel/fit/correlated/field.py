"""Exponentially correlated shadowing at places on lines: a Gaussian process with a tridiagonal precision matrix.

Between neighbours x apart the correlation is exp(-x / decorrelation) (Gudmundson, Electronics Letters 27 (1991)):
along a line that is the Ornstein-Uhlenbeck process, whose value at a place depends on its two neighbours alone (Rue &
Held, Gaussian Markov Random Fields (2005), ch. 1). So thousands of places cost no more than so many additions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from channel.checks import FloatArray
from channel.fit.cells import alike

FINEST_M = 0.02
"""Places nearer to each other than this are one."""
MOST_PLACES = 4000
FARTHEST_DECORRELATIONS = 40.0
"""Beyond so many decorrelation distances the correlation counts as none: exp(-40) is below the last bit."""


@dataclass(frozen=True, slots=True)
class PlacesOnLinks:
    """Where a log's packets were sent, along the line of each link.

    Attributes:
        of_packet: index of each packet's place, shape (packets,).
        gap_m: from each place to the next, infinite from one link to the next, shape (places - 1,).
        extent_m: the longest stretch of one link.
        spacing_m: median gap.
    """

    of_packet: NDArray[np.intp]
    gap_m: FloatArray
    extent_m: float
    spacing_m: float


def places_of(distance_m: FloatArray, link: NDArray[np.intp]) -> PlacesOnLinks:
    """Return the places of packets: those of one link lie on a line, at their distances.

    Args:
        distance_m: of each packet, shape (packets,).
        link: which link each belongs to, counted from 0.
    """
    order = np.lexsort((distance_m, link))
    last = np.flatnonzero(np.diff(link[order], append=-1))
    first = np.append(0, last[:-1] + 1)
    extents_m = distance_m[order[last]] - distance_m[order[first]]
    extent_m = float(np.max(extents_m))
    step_m = max(FINEST_M, float(np.sum(extents_m)) / MOST_PLACES)
    step = np.round(distance_m / step_m)
    places = alike(link, step)
    same = np.diff(link[places.first]) == 0
    gap_m = np.where(same, np.diff(step[places.first]) * step_m, np.inf)
    spacing_m = float(np.median(gap_m[same])) if same.any() else extent_m
    return PlacesOnLinks(places.of_row, gap_m, extent_m, spacing_m)


@dataclass(frozen=True, slots=True)
class Precision:
    """The inverse of a covariance: a symmetric tridiagonal matrix, and the logarithm of its determinant."""

    diagonal: FloatArray
    beside: FloatArray
    log_determinant: float

    @classmethod
    def of(cls, places: PlacesOnLinks, sigma_db: float, decorrelation_m: float) -> Precision:
        """Return that of the shadowing in dB at places."""
        step = np.minimum(places.gap_m / decorrelation_m, FARTHEST_DECORRELATIONS)
        correlation = np.exp(-step)
        left = -np.expm1(-2.0 * step)
        diagonal = np.ones(step.size + 1)
        diagonal[1:] += correlation**2 / left
        diagonal[:-1] += correlation**2 / left
        variance = sigma_db**2
        log_determinant = -diagonal.size * float(np.log(variance)) - float(np.sum(np.log(left)))
        return cls(diagonal / variance, -correlation / left / variance, log_determinant)

    def times(self, values: FloatArray) -> FloatArray:
        """Return the product with a vector."""
        out = self.diagonal * values
        out[:-1] += self.beside * values[1:]
        out[1:] += self.beside * values[:-1]
        return np.asarray(out)

    def joined(self, weight: FloatArray) -> Joined:
        """Return the matrix with weights, > 0 where any, added to its diagonal, factored."""
        diagonal = self.diagonal + weight
        ahead, beside, failed = lapack.dpttrf(diagonal, self.beside)
        behind, _, failed_behind = lapack.dpttrf(diagonal[::-1], self.beside[::-1])
        if failed or failed_behind:
            raise np.linalg.LinAlgError("not positive definite")
        return Joined(ahead, beside, 1.0 / (ahead + behind[::-1] - diagonal))


class Joined(NamedTuple):
    """A factored symmetric tridiagonal matrix: L D L^T.

    Attributes:
        pivots: D.
        below: L beside its diagonal.
        variance: the diagonal of the inverse: the pivots from one end and from the other say what both sides of a
            place leave of it.
    """

    pivots: FloatArray
    below: FloatArray
    variance: FloatArray

    @property
    def log_determinant(self) -> float:
        """Of the matrix."""
        return float(np.sum(np.log(self.pivots)))

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the inverse times right, shape (places, columns)."""
        return np.asarray(lapack.dpttrs(self.pivots, self.below, right)[0])
