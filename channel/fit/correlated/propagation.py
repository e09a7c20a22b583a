"""How likely a log is when its shadowing is correlated: the shadowing at each place integrated out.

Given the shadowing, packets are independent: one that arrived with RSSI has a normal reading about its power, and each
is a Bernoulli trial at its power. The shadowing is a Gaussian process; level and exponent have a flat prior, and are
integrated out with it, so that sigma is not estimated too small where the log is only a few decorrelation distances
long (as by REML). The readings are integrated exactly, the trials by expectation propagation: each is stood in for by a
normal factor with the same first moments beside all others (Minka, UAI 2001; Rasmussen & Williams, Gaussian Processes
for Machine Learning (2006), 3.6). Laplace's approximation fails here: about its highest place, a long stretch of
losses seems to cost nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.fit.correlated.field import PlacesOnLinks, Precision
from channel.fit.correlated.law import Law
from channel.fit.correlated.outcomes import Outcomes

MAX_ROUNDS = 40
SETTLED = 0.01
"""Of the log-likelihood, from one round to the next."""
DAMPING = 0.5
"""Of the step from round to round: packets near each other say the same, and would be heard twice."""
MOST_OF_VARIANCE = 0.999


class Integral(NamedTuple):
    """What is left, given a law.

    Attributes:
        value: log-likelihood.
        line: mean of the free ones of offset and exponent, shape (free,).
        covariance: of these, shape (free, free).
    """

    value: float
    line: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, slots=True)
class Readings:
    """The readings at each place, shape (places,).

    Attributes:
        count: how many.
        mean_dbm: of them, 0 where there are none.
        within: their sum of squares about it, of all places together.
        step_variance: of what rounding does, in dB squared; readings at one place are rounded alike.
    """

    count: FloatArray
    mean_dbm: FloatArray
    within: float
    step_variance: float

    def variance(self, error_db: float) -> FloatArray:
        """Return the variance of the mean reading at each place about the power; infinite where there is none."""
        own = error_db**2 - self.step_variance
        return np.where(self.count > 0.0, own / np.maximum(self.count, 1.0) + self.step_variance, np.inf)

    def log_likelihood_within(self, error_db: float) -> float:
        """Return that of readings of one place about their mean."""
        many = self.count[self.count > 1.0]
        apart = float(np.sum(many - 1.0)) * math.log(error_db) + 0.5 * float(np.sum(np.log(many)))
        return -apart - 0.5 * self.within / error_db**2


@dataclass(frozen=True, slots=True)
class Log:
    """A log as the integral takes it.

    Attributes:
        places: where packets were sent.
        fixed_dbm: mean power at each place but for what is free of offset and exponent, shape (places,).
        design: power per unit of these, shape (places, free).
        readings: of what arrived.
        place: of each cell of like packets whose outcome is in doubt, shape (doubtful,).
        packets: how many are in each.
        outcomes: what one of each says.
        certain: how many others arrived, at powers that leave no doubt.
    """

    places: PlacesOnLinks
    fixed_dbm: FloatArray
    design: FloatArray
    readings: Readings
    place: NDArray[np.intp]
    packets: FloatArray
    outcomes: Outcomes
    certain: int


class _Normal(NamedTuple):
    """The normal law that stands in for the posterior: mean and variance of each place's power; and its integral."""

    mean_dbm: FloatArray
    variance: FloatArray
    value: float
    line: FloatArray
    covariance: FloatArray


class CorrelatedLikelihood:
    """The integral over the shadowing of one log."""

    def __init__(self, log: Log) -> None:
        self._log = log
        self._start: tuple[FloatArray, FloatArray] | None = None
        self._last: tuple[FloatArray, FloatArray] | None = None

    def keep(self) -> None:
        """Let later calls start from where the last one ended."""
        self._start = self._last

    def integral(self, law: Law) -> Integral:
        """Return the log-likelihood given a law, and what is known of level and exponent."""
        log = self._log
        precision = Precision.of(log.places, law.sigma_db, law.decorrelation_m)
        last = math.inf
        floor_dbm = law.floor_dbm - log.fixed_dbm[log.place]
        weight, pull = self._first(law, floor_dbm) if self._start is None else self._start
        for _ in range(MAX_ROUNDS):
            normal = self._normal(law, precision, weight, pull)
            here, variance = normal.mean_dbm[log.place], normal.variance[log.place]
            left = variance / np.maximum(1.0 - weight * variance, 1.0 - MOST_OF_VARIANCE)
            mean = left * (here / variance - pull)
            said = log.outcomes.said(mean - floor_dbm, left, law)
            value = normal.value + float(np.sum(log.packets * (said.log - _factor(mean, left, weight, pull))))
            if abs(value - last) < SETTLED:
                break
            last = value
            rest = 1.0 - np.clip(left * said.bend, -1.0, MOST_OF_VARIANCE)
            new_weight = said.bend / rest
            new_pull = (said.slope + mean * said.bend) / rest
            flat = new_weight < 0.0
            new_weight[flat], new_pull[flat] = 0.0, said.slope[flat]
            weight = weight + DAMPING * (new_weight - weight)
            pull = pull + DAMPING * (new_pull - pull)
        self._last = weight, pull
        value += log.certain * math.log(max(1.0 - law.base_loss, 1e-9))
        return Integral(value, normal.line, normal.covariance)

    def _first(self, law: Law, floor_dbm: FloatArray) -> tuple[FloatArray, FloatArray]:
        weight, snr_db = self._log.outcomes.first(law)
        return weight, weight * (snr_db + floor_dbm)

    def _normal(self, law: Law, precision: Precision, weight: FloatArray, pull: FloatArray) -> _Normal:
        """Return the normal law of the power (less what is fixed) with the readings and the factors."""
        log, design = self._log, self._log.design
        places = log.fixed_dbm.size
        seen = 1.0 / log.readings.variance(law.scatter_db)
        all_weight = seen + np.bincount(log.place, log.packets * weight, places)
        by_factor = np.bincount(log.place, log.packets * pull, places)
        all_pull = seen * (log.readings.mean_dbm - log.fixed_dbm) + by_factor
        weighted = all_weight[:, np.newaxis] * design
        joined = precision.joined(all_weight)
        solved = joined.solve(np.concatenate((all_pull[:, np.newaxis], weighted), axis=1))
        bend = weighted.T @ (design - solved[:, 1:]) + 1e-9 * np.eye(design.shape[1])
        covariance = np.linalg.inv(bend)
        line = covariance @ (design.T @ all_pull - weighted.T @ solved[:, 0])
        shadowing = solved[:, 0] - solved[:, 1:] @ line
        power = design @ line + shadowing
        apart = design - solved[:, 1:]
        variance = np.asarray(
            joined.variance + np.sum((apart @ covariance) * apart, axis=1), dtype=np.float64
        )
        residual = log.readings.mean_dbm - log.fixed_dbm - power
        squares = float(seen @ (residual * residual)) - float(np.sum(np.log(seen[seen > 0.0])))
        value = (
            float(by_factor @ power - 0.5 * ((all_weight - seen) @ (power * power)))
            - 0.5 * squares
            + log.readings.log_likelihood_within(law.scatter_db)
            - 0.5 * float(shadowing @ precision.times(shadowing))
            + 0.5 * (precision.log_determinant - joined.log_determinant - float(np.linalg.slogdet(bend)[1]))
        )
        return _Normal(power, variance, value, line, np.asarray(covariance, dtype=np.float64))


def _factor(mean: FloatArray, variance: FloatArray, weight: FloatArray, pull: FloatArray) -> FloatArray:
    """Return the log of the integral of a factor exp(-weight x^2 / 2 + pull x) over a normal law."""
    total = 1.0 + weight * variance
    return np.asarray(
        (pull * mean - 0.5 * weight * mean**2 + 0.5 * pull**2 * variance) / total - 0.5 * np.log(total)
    )
