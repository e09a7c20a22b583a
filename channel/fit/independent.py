"""Fitting a log whose packets are independent of each other, by maximum likelihood.

Intervals hold the values whose profile deviance is below the chi-squared quantile (Wilks).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from channel.config import RadioConfig
from channel.fit.correlated.ends import correlations_of
from channel.fit.flight_log import FlightLog
from channel.fit.goodness import readings_and_deliveries
from channel.fit.likelihood import (
    ALL_NAMES,
    ERROR,
    EXPONENT,
    FLOOR,
    NAMES,
    OFFSET,
    SIGMA,
    Likelihood,
    Parameters,
    Point,
)
from channel.fit.profile import HIGHER, HigherError, Mask, Side, climb, interval_end
from channel.fit.residuals import DEPENDENT
from channel.fit.result import GIVEN, Estimate, Fit, Goodness

CHI2_95 = 3.841458820694124
RESTARTS = 12
MOST_STARTS = 3
STARTS_SIGMA_DB = (1.0, 4.0, 9.0)
STARTS_EXPONENT = (2.0, 3.5, 6.0, 12.0)
RIDGE_EXPONENTS = (0.7, 1.0, 1.5, 2.0, 3.0, 4.0, 5.5, 7.5, 10.0, 14.0, 20.0)


def _shadowed(overrides: dict[str, Any], base: RadioConfig, independent: float) -> dict[str, Any]:
    """Return the overrides, with shadowing of a packet each where the base's is correlated and the log's is not."""
    if base.shadowing.decorrelation_m is not None and independent > DEPENDENT:
        overrides["shadowing"] |= {"model": "normal"}
    return overrides


def independent_fit(
    log: FlightLog,
    base: RadioConfig,
    likelihood: Likelihood,
    free: Mask,
    held: frozenset[str],
    top: Top,
    independent: float,
) -> Fit:
    """Return the fit of a log whose packets are taken as independent of each other."""
    best, ends = _intervals(likelihood, free, top)
    estimates = tuple(_estimate(i, best, ends.get(i), likelihood, held) for i in range(len(NAMES)))
    names, covariance = likelihood.covariance(best, _determined(free, estimates))
    settled = likelihood.point(_settled(likelihood, best, free, ends, likelihood.base_values))
    return Fit(
        estimates=estimates,
        log_likelihood=best.value,
        packets=log.packets,
        delivered=int(np.count_nonzero(log.delivered)),
        overrides=_shadowed(likelihood.overrides(settled.at), base, independent),
        rssi_error_db=float(best.at[ERROR]) if likelihood.has_rssi else None,
        level=likelihood.level(best, settled, names, covariance, free),
        correlations=correlations_of(names, covariance),
        goodness=Goodness(independent, *readings_and_deliveries(likelihood, settled), independent),
    )


def free_parameters(likelihood: Likelihood, held: frozenset[str]) -> Mask:
    """Return what is to be fitted. Without RSSI only the difference of offset and noise floor shows: one is given."""
    free = np.array([name not in held for name in ALL_NAMES])
    free[ERROR] = likelihood.has_rssi
    if not likelihood.has_rssi:
        free[FLOOR] &= not free[OFFSET]
    return free


Ends = dict[int, tuple[float, float]]


class Top(NamedTuple):
    """The highest place, and the best there is at each of many exponents."""

    best: Point
    ridge: list[Point]


def highest(likelihood: Likelihood, free: Mask, known: Parameters) -> Top:
    """Return the maximum, what is not free as known."""
    best = _climb_from_everywhere(likelihood, free, known)
    ridge = _ridge(likelihood, best, free, known)
    best = max(
        (best, *(climb(likelihood, point.at, free) for point in ridge if point.value > best.value)),
        key=_value,
    )
    return Top(best, ridge)


def _intervals(likelihood: Likelihood, free: Mask, top: Top) -> tuple[Point, Ends]:
    """Return the maximum and the ends of the intervals; from a higher maximum, if the search finds one."""
    best, ridge = top
    for restarts_left in range(RESTARTS, -1, -1):
        ceiling = best.value + HIGHER if restarts_left else math.inf
        try:
            return best, {
                i: _ends(likelihood, best, free, i, ceiling, ridge) for i in range(len(NAMES)) if free[i]
            }
        except HigherError as higher:
            best = climb(likelihood, higher.point.at, free)
    raise AssertionError("the last search has no ceiling")


def _ends(
    likelihood: Likelihood, best: Point, free: Mask, index: int, ceiling: float, ridge: Sequence[Point]
) -> tuple[float, float]:
    target = best.value - 0.5 * CHI2_95
    sides = (
        Side(index, sign, target, ceiling, float(limits[index]))
        for sign, limits in ((-1.0, likelihood.low), (1.0, likelihood.high))
    )
    low, high = (interval_end(likelihood, best, free, side, ridge) for side in sides)
    return (likelihood.sigma_db(low), likelihood.sigma_db(high)) if index == SIGMA else (low, high)


def _climb_from_everywhere(likelihood: Likelihood, free: Mask, known: Parameters) -> Point:
    """Return the best of the maxima that several starts lead to."""
    exponents = STARTS_EXPONENT if free[EXPONENT] else (float(known[EXPONENT]),)
    sigmas_db = STARTS_SIGMA_DB if free[SIGMA] else (likelihood.sigma_db(float(known[SIGMA])),)
    starts = [np.where(free, start, known) for start in likelihood.starts(exponents, sigmas_db)]
    starts.sort(key=lambda start: likelihood.point(start).value, reverse=True)
    return max(
        (climb(likelihood, start, free) for start in starts[:MOST_STARTS]), key=lambda each: each.value
    )


def _ridge(likelihood: Likelihood, best: Point, free: Mask, known: Parameters) -> list[Point]:
    """Return the best there is at each of many exponents.

    Without RSSI a steep law with much shadowing is nearly as likely as a flat one with little: the likelihood is a
    long ridge, on which a search that starts at its highest point may not come far.
    """
    if likelihood.has_rssi or not free[EXPONENT]:
        return []
    sigmas_db = STARTS_SIGMA_DB if free[SIGMA] else (likelihood.sigma_db(float(known[SIGMA])),)
    others = free.copy()
    others[EXPONENT] = False
    points = []
    for exponent in RIDGE_EXPONENTS:
        starts = [*likelihood.starts((exponent,), sigmas_db), likelihood.at_exponent(best.at, exponent)]
        allowed = (np.where(free, likelihood.inside(at), known) for at in starts)
        start = max((likelihood.point(at) for at in allowed), key=_value)
        points.append(climb(likelihood, start.at, others))
    return points


def _value(point: Point) -> float:
    return point.value


def _estimate(
    index: int, best: Point, ends: tuple[float, float] | None, likelihood: Likelihood, held: frozenset[str]
) -> Estimate:
    name = NAMES[index]
    if ends is None:
        note = "as given" if name in held else f"without RSSI it cannot be separated from {_twin(name)}"
        return Estimate(name, None, -math.inf, math.inf, f"{note}: {GIVEN}")
    low, high = ends
    if math.isinf(low) or math.isinf(high):
        return Estimate(name, None, low, high, "the data do not determine it")
    note = ""
    if not likelihood.has_rssi and name in {"offset_db", "noise.floor_dbm"} and _twin(name) not in held:
        note = "if the noise floor is the base radio's: without RSSI only their difference shows"
    return Estimate(name, float(likelihood.natural(best.at)[index]), low, high, note)


def _twin(name: str) -> str:
    return "noise.floor_dbm" if name == "offset_db" else "offset_db"


def _determined(free: Mask, estimates: tuple[Estimate, ...]) -> Mask:
    """Return what was fitted and determined."""
    determined = free.copy()
    determined[: len(NAMES)] &= [estimate.value is not None for estimate in estimates]
    return determined


def _settled(likelihood: Likelihood, best: Point, free: Mask, ends: Ends, known: Parameters) -> Parameters:
    """Return the values for a radio: what the data do not determine is known, the rest the best beside it.

    One after the other: offset and sigma, open beside an open exponent, may be determined as soon as it is known. A
    known value beyond the end that the data do set goes there.
    """
    undetermined = [i for i, interval in ends.items() if not np.isfinite(interval).all()]
    if not undetermined:
        return best.at
    first = undetermined[0]
    values, fewer = likelihood.natural(known), free.copy()
    values[first] = np.clip(values[first], *ends[first])
    fewer[first] = False
    known = likelihood.coordinates(values)
    if not fewer[: len(NAMES)].any():
        return known
    best, ends = _intervals(likelihood, fewer, highest(likelihood, fewer, known))
    return _settled(likelihood, best, fewer, ends, known)
