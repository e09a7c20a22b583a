"""The parameters of correlated shadowing as coordinates for a search, and the sample of them that a log leaves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.fit.correlated.law import Law
from channel.fit.correlated.posterior import Mode, WeightedSample, climbed, sample
from channel.fit.correlated.propagation import CorrelatedLikelihood, Integral

SIGMA, DECORRELATION, SCATTER, FLOOR, BASE = range(5)
STEP = np.array([0.1, 0.3, 0.15, 0.3, 0.05])
WIDEST = np.array([0.7, 1.0, 2.0, 5.0, 0.3])
LOW = np.array([math.log(0.05), math.log(0.05), -10.0, -500.0, -0.99])
HIGH = np.array([math.log(60.0), math.log(1e6), 10.0, 100.0, 0.99])
LEAST_SCATTER_DB = 0.05
DECORRELATIONS = (150.0, 60.0, 25.0, 10.0, 4.0)
"""Of the extent of a log, from which to start."""
SCATTERS_DB = (0.3, 3.0)
UNKNOWN_FLOOR_DB = 12.0
UNDETERMINED = 1.92


@dataclass(frozen=True, slots=True)
class Found:
    """What a log says of correlated shadowing.

    Attributes:
        law: at the mode.
        at_mode: level and exponent there.
        value: log-likelihood there.
        free: which coordinates were searched.
        laws: of the sample, shape (points, 5), in natural units.
        lines: mean of level and exponent at each point, shape (points, free ones).
        covariances: of these.
        weight: of each point.
        effective: number of points that count.
        base_may_be_zero: whether a log without base loss is as likely.
    """

    law: Law
    at_mode: Integral
    value: float
    free: NDArray[np.bool_]
    laws: FloatArray
    lines: FloatArray
    covariances: FloatArray
    weight: FloatArray
    effective: float
    base_may_be_zero: bool


class Search:
    """A search for the parameters of one log.

    Coordinates: the logarithms of sigma and of the decorrelation distance; signed roots of the receiver's variance and
    of the base loss, so that 0 is a place like any other and the prior of the base loss is Jeffreys's; the floor.

    Args:
        likelihood: of the log.
        extent_m: of its places: a prior falls off for decorrelation distances above it, which no log can show.
        step_variance: of what rounding does to readings, dB squared.
        most_scatter_db: of readings; a prior falls off above it.
        known: values in coordinates of what is not free.
        free: what is.
    """

    def __init__(
        self,
        likelihood: CorrelatedLikelihood,
        extent_m: float,
        step_variance: float,
        most_scatter_db: float,
        known: Law,
        free: NDArray[np.bool_],
    ) -> None:
        self._likelihood = likelihood
        self._extent_m = extent_m
        self._least_variance = step_variance
        self._most_scatter_db = most_scatter_db
        self._known = coordinates(known)
        self.free = free
        self._seen: list[Integral] = []

    def law(self, at: FloatArray) -> Law:
        """Return the law at free coordinates."""
        full = self._known.copy()
        full[self.free] = at
        full = np.clip(full, LOW, HIGH)
        return Law(
            math.exp(full[SIGMA]),
            math.exp(full[DECORRELATION]),
            math.sqrt(self._least_variance + full[SCATTER] ** 2),
            float(full[FLOOR]),
            float(full[BASE] ** 2),
        )

    def density(self, at: FloatArray) -> float:
        """Return the log-density at free coordinates."""
        law = self.law(at)
        found = self._likelihood.integral(law)
        self._seen.append(found)
        beyond = max(law.scatter_db - self._most_scatter_db, 0.0) / STEP[SCATTER]
        return float(found.value - math.log1p(law.decorrelation_m / self._extent_m) - beyond**2)

    def run(self) -> Found:
        """Return what the log says."""
        start = self._start()
        self.density(start)
        self._likelihood.keep()
        top = climbed(self.density, start, STEP[self.free], WIDEST[self.free])
        top = self._without_unknown_floor(top)
        at_mode = self._likelihood.integral(self.law(top.at))
        self._likelihood.keep()
        may_be_zero = self._base_may_be_zero(top)
        self._seen = []
        points = sample(self.density, top)
        return self._found(top, at_mode, points, may_be_zero)

    def _found(self, top: Mode, at_mode: Integral, points: WeightedSample, may_be_zero: bool) -> Found:
        seen = self._seen[-len(points.weight) :]
        return Found(
            law=self.law(top.at),
            at_mode=at_mode,
            value=top.value,
            free=self.free,
            laws=np.array([self.law(at) for at in points.at]),
            lines=np.array([each.line for each in seen]),
            covariances=np.array([each.covariance for each in seen]),
            weight=points.weight,
            effective=points.effective,
            base_may_be_zero=may_be_zero,
        )

    def _start(self) -> FloatArray:
        """Return the best of several decorrelation distances, with readings that scatter little or much."""
        starts = []
        for share, scatter_db in product(DECORRELATIONS, SCATTERS_DB):
            full = self._known.copy()
            full[DECORRELATION] = math.log(self._extent_m / share)
            full[SCATTER] = scatter_db
            starts.append(np.where(self.free, full, self._known)[self.free])
        return max(starts, key=self.density)

    def _place(self, index: int) -> int:
        return int(np.count_nonzero(self.free[:index]))

    def _without_unknown_floor(self, top: Mode) -> Mode:
        """Return the mode; with the floor held where it is if a far other one is as likely."""
        if not self.free[FLOOR]:
            return top
        place = self._place(FLOOR)
        for sign in (-1.0, 1.0):
            at = top.at.copy()
            at[place] += sign * UNKNOWN_FLOOR_DB
            if self.density(at) > top.value - UNDETERMINED:
                self._known[self.free] = top.at
                self.free = self.free.copy()
                self.free[FLOOR] = False
                start = np.delete(top.at, place)
                return climbed(self.density, start, STEP[self.free], WIDEST[self.free])
        return top

    def _base_may_be_zero(self, top: Mode) -> bool:
        """Return whether no base loss at all is nearly as likely, the rest moved along with it."""
        if not self.free[BASE]:
            return False
        place = self._place(BASE)
        along = top.covariance[:, place] / top.covariance[place, place]
        at = top.at - along * top.at[place]
        return self.density(at) > top.value - UNDETERMINED


def coordinates(law: Law) -> FloatArray:
    """Return the coordinates of a law whose scatter is without that of steps."""
    return np.array(
        [
            math.log(law.sigma_db),
            math.log(law.decorrelation_m),
            law.scatter_db,
            law.floor_dbm,
            math.sqrt(law.base_loss),
        ]
    )
