"""Fitting a radio to a log whose packets depend on their neighbours: shadowing that is correlated along the track."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.config import RadioConfig
from channel.fit.correlated.field import PlacesOnLinks, places_of
from channel.fit.correlated.innovations import Leftover, leftover
from channel.fit.correlated.outcomes import FINE_SNR_DB, Outcomes
from channel.fit.correlated.posterior import mixture_quantile, quantile
from channel.fit.correlated.propagation import CorrelatedLikelihood, Law, Log, Readings
from channel.fit.correlated.search import (
    BASE,
    DECORRELATION,
    ERROR,
    FLOOR,
    LEAST_ERROR_DB,
    SIGMA,
    Found,
    Search,
)
from channel.fit.flight_log import FlightLog
from channel.fit.likelihood import power_at_reference_dbm
from channel.fit.result import Estimate, Level
from channel.fit.rssi_law import step_of
from channel.phy.error_model import Band

DECORRELATION_NAME = "shadowing.decorrelation_m"
LINE_NAMES = ("propagation.exponent", "offset_db")
LAW_NAMES = {
    "shadowing.sigma_db": SIGMA,
    DECORRELATION_NAME: DECORRELATION,
    "noise.floor_dbm": FLOOR,
    "base_loss": BASE,
}
TAIL = 0.025
STRETCH = 1.15
"""Of each arm of an interval, from the median: an allowance for what is approximate in the integral and the sample."""
CERTAIN = 1e-9
"""Chance of a loss below which an arrival says nothing of the floor, with a margin of power on top."""
MARGIN_DB = 12.0
WILD = 7.0
"""A reading that is so many sigma from the mean is an arrival without one."""
NOTED_ERROR_DB = 0.5
LEAST_EFFECTIVE = 15.0
LEAST_SIGMA_DB = 0.3


class CorrelatedFit:
    """What a log says when its shadowing is correlated.

    Args:
        log: the flight log.
        base: the radio to start from.
        near: exponent, offset, sigma, base loss and floor of a fit without correlation; or known values.
        held: names of what is known.
    """

    def __init__(self, log: FlightLog, base: RadioConfig, near: FloatArray, held: frozenset[str]) -> None:
        self._base, self._near, self._held = base, near, held
        self._reference_m = float(getattr(base.propagation, "reference_distance_m", 1.0))
        self._distance_m = np.maximum(log.distance_m, base.min_distance_m)
        self._decades = np.log10(self._distance_m / self._reference_m)
        self._level_dbm = power_at_reference_dbm(base, self._reference_m)
        self._log = log
        self._rssi_dbm = self._without_wild_readings()
        self._heard = np.isfinite(self._rssi_dbm)
        self._step_variance = LEAST_ERROR_DB**2 + step_of(self._rssi_dbm[self._heard]) ** 2 / 12.0
        self.places = places_of(self._distance_m, log.link)
        self._line_free = np.array([name not in held for name in LINE_NAMES])
        self._taken = self._as_taken()
        self.found = self._search()
        self.leftover: Leftover = leftover(
            self._taken, self.found, self.places, self._rssi_dbm, self._sure_dbm()
        )

    def _without_wild_readings(self) -> FloatArray:
        exponent, offset, sigma_db = self._near[:3]
        mean = self._level_dbm + offset - 10.0 * exponent * self._decades
        wild = np.abs(self._log.rssi_dbm - mean) > WILD * max(sigma_db, 1.0)
        return np.where(self._log.delivered & ~wild, self._log.rssi_dbm, np.nan)

    def _sure_dbm(self) -> float:
        """Return the power above which nothing is lost but by base loss, if the floor is where it seemed."""
        base, longest = self._base, float(np.max(self._log.length_bytes))
        lost = base.error.per(FINE_SNR_DB, longest, Band(base.bandwidth_hz, base.bit_rate_bps))
        above = FINE_SNR_DB[np.flatnonzero(lost > CERTAIN)]
        return float(self._near[4]) + (float(above[-1]) if above.size else -math.inf)

    def _as_taken(self) -> Log:
        """Return the log by place."""
        log, base, places = self._log, self._base, self.places
        count = places.gap_m.size + 1
        decades = np.zeros(count)
        decades[places.of_packet] = self._decades
        columns = np.stack((-10.0 * decades, np.ones(count)), axis=-1)
        held = ~self._line_free
        known = self._near[:2]
        doubtful = ~self._heard | (self._rssi_dbm < self._sure_dbm() + MARGIN_DB)
        lengths, length = np.unique(log.length_bytes[doubtful], return_inverse=True)
        outcomes = Outcomes(
            base.error,
            Band(base.bandwidth_hz, base.bit_rate_bps),
            lengths.tolist(),
            length.reshape(-1),
            log.delivered[doubtful],
        )
        return Log(
            places=places,
            fixed_dbm=self._level_dbm + columns[:, held] @ known[held],
            design=columns[:, self._line_free],
            readings=self._readings(places, count),
            place=places.of_packet[doubtful],
            outcomes=outcomes,
            certain=int(np.count_nonzero(~doubtful)),
        )

    def _readings(self, places: PlacesOnLinks, places_count: int) -> Readings:
        where, rssi = places.of_packet[self._heard], self._rssi_dbm[self._heard]
        count = np.bincount(where, minlength=places_count).astype(np.float64)
        mean = np.bincount(where, rssi, places_count) / np.maximum(count, 1.0)
        return Readings(count, mean, float(np.sum((rssi - mean[where]) ** 2)), self._step_variance)

    def _search(self) -> Found:
        _, _, sigma_db, base_loss, floor_dbm = self._near
        has_rssi = bool(self._heard.any())
        free = np.empty(5, dtype=bool)
        for name, index in LAW_NAMES.items():
            free[index] = name not in self._held
        free[ERROR] = has_rssi
        if not has_rssi and self._line_free[1]:
            free[FLOOR] = False
        if free[FLOOR] and self._log.delivered.all():
            free[FLOOR] = False
            floor_dbm = min(
                self._base.noise.noise_floor_dbm(self._base.bandwidth_hz),
                float(np.nanmin(self._rssi_dbm)) - 30.0,
            )
        decorrelation_m = self._base.shadowing.decorrelation_m or 20.0
        known = Law(
            max(float(sigma_db), LEAST_SIGMA_DB), decorrelation_m, 0.3, float(floor_dbm), float(base_loss)
        )
        likelihood = CorrelatedLikelihood(self._taken)
        return Search(likelihood, self.places.extent_m, self._step_variance, known, free).run()

    @property
    def settled(self) -> bool:
        """Whether the sample can carry an interval."""
        return self.found.effective >= LEAST_EFFECTIVE

    @property
    def values(self) -> dict[str, float]:
        """The most likely values by name."""
        found = self.found
        out = {name: float(found.law[index]) for name, index in LAW_NAMES.items()}
        out |= dict(zip(LINE_NAMES, self._near[:2].tolist(), strict=True))
        free = [name for name, is_free in zip(LINE_NAMES, self._line_free, strict=True) if is_free]
        return out | dict(zip(free, found.at_mode.line.tolist(), strict=True))

    def estimates(self) -> tuple[Estimate, ...]:
        """Return exponent, offset, sigma, base loss, floor and decorrelation distance."""
        names = (*LINE_NAMES, "shadowing.sigma_db", "base_loss", "noise.floor_dbm", DECORRELATION_NAME)
        return tuple(self._estimate(name) for name in names)

    def _estimate(self, name: str) -> Estimate:
        if name in self._held:
            return Estimate(name, None, -math.inf, math.inf, "as given: the base radio's")
        ends = self._ends(name)
        if ends is None:
            return Estimate(name, None, -math.inf, math.inf, "the data do not determine it")
        low, high = ends
        if math.isinf(low) or math.isinf(high):
            return Estimate(name, None, low, high, "the data do not determine it")
        return Estimate(name, min(max(self.values[name], low), high), low, high, self._note(name))

    def _note(self, name: str) -> str:
        error_db = self.rssi_error_db() or 0.0
        if name != "noise.floor_dbm" or error_db < NOTED_ERROR_DB:
            return ""
        return f"if it is the readings that err by {error_db:.1f} dB, and not the positions"

    def _ends(self, name: str) -> tuple[float, float] | None:
        """Return the interval; None where nothing is known."""
        found = self.found
        if not self.settled:
            return None
        if name in LINE_NAMES:
            return self._line_ends(np.array([name == each for each in LINE_NAMES], dtype=np.float64))[1:]
        index = LAW_NAMES[name]
        if not found.free[index]:
            return None
        into, back = SCALES[index]
        values = into(found.laws[:, index])
        low, high = (
            float(back(end)) for end in _stretched(lambda level: quantile(values, found.weight, level))
        )
        if index == BASE and found.base_may_be_zero:
            low = 0.0
        if index == DECORRELATION:
            high = high if high < self.places.extent_m else math.inf
        return low, high

    def _line_ends(self, along: FloatArray) -> tuple[float, float, float]:
        """Return mode and ends of a sum of exponent and offset; what is held is known."""
        found, free = self.found, self._line_free
        known = float(along[~free] @ self._near[:2][~free])
        part = along[free]
        mean = found.lines @ part + known
        deviation = np.sqrt(np.einsum("i,kij,j->k", part, found.covariances, part))
        low, high = _stretched(lambda level: mixture_quantile(mean, deviation, found.weight, level))
        return float(found.at_mode.line @ part) + known, low, high

    def level(self) -> Level | None:
        """Return the mean power at the log's mean distance."""
        if not self._line_free.any():
            return None
        decades = float(np.mean(self._decades))
        fixed = self._level_dbm
        value, low, high = self._line_ends(np.array([-10.0 * decades, 1.0]))
        if not self.settled:
            low, high = -math.inf, math.inf
        return Level(self._reference_m * 10.0**decades, value + fixed, low + fixed, high + fixed)

    def correlations(self) -> dict[str, dict[str, float]]:
        """Return the correlations of what was fitted."""
        found = self.found
        lines = [name for name, is_free in zip(LINE_NAMES, self._line_free, strict=True) if is_free]
        laws = {name: index for name, index in LAW_NAMES.items() if found.free[index]}
        points = np.concatenate((found.lines, found.laws[:, list(laws.values())]), axis=1)
        apart = points - found.weight @ points
        covariance = apart.T @ (found.weight[:, np.newaxis] * apart)
        covariance[: len(lines), : len(lines)] += np.einsum("k,kij->ij", found.weight, found.covariances)
        return correlations_of((*lines, *laws), covariance)

    def rssi_error_db(self) -> float | None:
        """Return the receiver's own error of a reading, beyond its steps."""
        if not self._heard.any():
            return None
        return math.sqrt(max(self.found.law.error_db**2 - self._step_variance, 0.0))


def _stretched(quantile_at: Callable[[float], float]) -> tuple[float, float]:
    """Return the ends of an interval."""
    middle = quantile_at(0.5)
    low, high = (middle + STRETCH * (quantile_at(level) - middle) for level in (TAIL, 1.0 - TAIL))
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
