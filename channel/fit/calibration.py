"""Fitting a radio to a flight log by maximum likelihood, with profile-likelihood intervals.

What is fitted: the exponent of a log-distance law, an offset of the received power, the spread of the shadowing and
the base loss; with received powers (RSSI) in the log also the noise floor. The error model is the base radio's.
With RSSI the receiver's own error of it, up to 3 dB, is fitted along: it blurs at which power packets get lost, and the
edge of one-sided shadowing.

Intervals hold the values whose profile deviance is below the chi-squared quantile (Wilks).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from channel.checks import ChannelInputError, FloatArray
from channel.config import RadioConfig
from channel.fading.shadowing import OneSidedNormalShadowing
from channel.fit.correlated.fit import DECORRELATION_NAME, CorrelatedFit, correlations_of
from channel.fit.correlated.search import FLOOR as FLOOR_COORDINATE
from channel.fit.flight_log import FlightLog
from channel.fit.goodness import readings_and_deliveries
from channel.fit.likelihood import (
    ALL_NAMES,
    ERROR,
    EXPONENT,
    FLOOR,
    LIMITS,
    NAMES,
    OFFSET,
    SIGMA,
    Likelihood,
    Parameters,
    Point,
)
from channel.fit.profile import HIGHER, HigherError, Mask, Side, climb, interval_end
from channel.fit.residuals import DEPENDENT, along, chance_of_independence
from channel.fit.result import Estimate, Fit, Goodness
from channel.presets import merged, radio_from_mapping

CHI2_95 = 3.841458820694124
MIN_PACKETS = 20
RESTARTS = 12
MOST_STARTS = 3
STARTS_SIGMA_DB = (1.0, 4.0, 9.0)
STARTS_EXPONENT = (2.0, 3.5, 6.0, 12.0)
RIDGE_EXPONENTS = (0.7, 1.0, 1.5, 2.0, 3.0, 4.0, 5.5, 7.5, 10.0, 14.0, 20.0)


class NotEnoughInformationError(ValueError):
    """A log from which nothing can be fitted; the message says what it lacks."""


ONE_SIDED_NOTE = (
    "neighbouring packets depend on each other, which one-sided shadowing has no law for: an interval would be too "
    "narrow; try --set shadowing.model=normal"
)
NO_RSSI_NOTE = (
    "neighbouring packets depend on each other, and without RSSI it cannot be told how far: an interval would be too "
    "narrow; log RSSI"
)
PLACES_NOTE = (
    "neighbouring packets depend on each other beyond what their distances explain: an interval would be too "
    "narrow"
)


def fit_radio(log: FlightLog, base: RadioConfig, hold: Iterable[str] = ()) -> Fit:
    """Fit a radio to a log.

    Args:
        log: of one link or of many with the same radio.
        base: gives the error model, powers, gains, kind of shadowing, and what the data do not determine. Its
            propagation has to be log-distance and its shadowing normal, Gudmundson's or one-sided normal.
        hold: names of parameters that are known, and stay the base's.

    Raises:
        NotEnoughInformationError: too few packets, all or none delivered, or all at one distance.
        ChannelInputError: a base of another kind.
    """
    held = _known_names(hold)
    if DECORRELATION_NAME in held and base.shadowing.decorrelation_m is None:
        raise ChannelInputError(
            "shadowing.model", base.shadowing.model, f"gudmundson, to hold {DECORRELATION_NAME}"
        )
    log = _within_range(log, base)
    _check(log, base)
    likelihood = Likelihood(log, base)
    _check_held(likelihood, held)
    free = _free(likelihood, held)
    top = _top(likelihood, free)
    independent = chance_of_independence(likelihood.scores(top.best.at), along(log.distance_m, log.link))
    if independent > DEPENDENT:
        return _independent_fit(log, base, likelihood, free, held, top, independent)
    one_sided = isinstance(base.shadowing, OneSidedNormalShadowing)
    if one_sided or not likelihood.has_rssi:
        fit = _independent_fit(log, base, likelihood, free, held, top, independent)
        return _without_intervals(fit, ONE_SIDED_NOTE if one_sided else NO_RSSI_NOTE)
    return _correlated_fit(log, base, likelihood.natural(top.best.at)[: len(NAMES)], held, independent)


def _independent(overrides: dict[str, Any], base: RadioConfig) -> dict[str, Any]:
    """Return the overrides, with shadowing of a packet each where the base's is correlated."""
    if base.shadowing.decorrelation_m is not None:
        overrides["shadowing"] |= {"model": "normal"}
    return overrides


def _independent_fit(
    log: FlightLog,
    base: RadioConfig,
    likelihood: Likelihood,
    free: Mask,
    held: frozenset[str],
    top: _Top,
    independent: float,
) -> Fit:
    """Return the fit of a log whose packets are independent of each other."""
    best, ends = _intervals(likelihood, free, top)
    estimates = tuple(_estimate(i, best, ends.get(i), likelihood, held) for i in range(len(NAMES)))
    names, covariance = likelihood.covariance(best, _determined(free, estimates))
    return Fit(
        estimates=estimates,
        log_likelihood=best.value,
        packets=log.packets,
        delivered=int(np.count_nonzero(log.delivered)),
        overrides=_independent(likelihood.overrides(_settled(likelihood, best, free, estimates)), base),
        rssi_error_db=float(best.at[ERROR]) if likelihood.has_rssi else None,
        level=likelihood.level(best, names, covariance, free),
        correlations=correlations_of(names, covariance),
        goodness=Goodness(independent, *readings_and_deliveries(likelihood, best), independent),
    )


def _correlated_fit(
    log: FlightLog, base: RadioConfig, near: FloatArray, held: frozenset[str], independent: float
) -> Fit:
    """Return the fit of a log whose shadowing is correlated along the track."""
    fit = CorrelatedFit(log, base, near, held)
    values, found = fit.values, fit.found
    shadowing = {"sigma_db": values["shadowing.sigma_db"], "decorrelation_m": values[DECORRELATION_NAME]}
    overrides: dict[str, Any] = {
        "propagation": {"exponent": values["propagation.exponent"]},
        "offset_db": values["offset_db"],
        "shadowing": {"model": "gudmundson", **shadowing},
        "base_loss": values["base_loss"],
    }
    if found.free[FLOOR_COORDINATE]:
        overrides["noise"] = {"model": "fixed", "floor_dbm": values["noise.floor_dbm"]}
    left = fit.leftover
    out = Fit(
        estimates=fit.estimates(),
        log_likelihood=found.value,
        packets=log.packets,
        delivered=int(np.count_nonzero(log.delivered)),
        overrides=overrides,
        rssi_error_db=fit.rssi_error_db(),
        level=fit.level(),
        correlations=fit.correlations(),
        correlated=True,
        goodness=Goodness(left.independence, left.readings, None, independent),
    )
    if left.independence is not None and left.independence < DEPENDENT:
        return _without_intervals(out, PLACES_NOTE)
    return out


def _without_intervals(fit: Fit, why: str) -> Fit:
    """Return a fit that claims nothing of what it fitted: its intervals would be too narrow."""
    estimates = tuple(
        Estimate(each.name, None, -math.inf, math.inf, each.note if "base radio" in each.note else why)
        for each in fit.estimates
    )
    level = fit.level and replace(fit.level, low_dbm=-math.inf, high_dbm=math.inf)
    return replace(fit, estimates=estimates, level=level)


def fitted_radio(fit: Fit, base: RadioConfig, name: str) -> RadioConfig:
    """Return the base radio with the fitted values laid over it, under a name."""
    tree = base.model_dump(mode="json", by_alias=True, exclude_none=True)
    if "model" in fit.overrides["shadowing"]:
        del tree["shadowing"]
    tree = merged(tree, fit.overrides)
    tree |= {
        "name": name,
        "description": f"{base.name}, fitted to {fit.packets} packets of which {fit.delivered} arrived",
        "source": "lostlink fit",
    }
    return radio_from_mapping(tree)


def _known_names(hold: Iterable[str]) -> frozenset[str]:
    held = frozenset(hold)
    names = (*NAMES, DECORRELATION_NAME)
    if not held <= set(names):
        raise ChannelInputError("hold", sorted(held - set(names)), f"names among {', '.join(names)}")
    return held


def _check_held(likelihood: Likelihood, held: frozenset[str]) -> None:
    """Refuse a known value that is beyond what a fit can take: it would be moved to where it can."""
    values = likelihood.natural(likelihood.base_values)
    for name, value in zip(ALL_NAMES, values.tolist(), strict=True):
        low, high = LIMITS[name]
        if name in held and not low <= value <= high * (1.0 + 1e-9):
            raise ChannelInputError(name, value, f"{low:g} to {high:g}, to be held in a fit")


def _within_range(log: FlightLog, base: RadioConfig) -> FlightLog:
    """Return the packets within the radio's maximal range: beyond it nothing arrives, whatever else the radio is."""
    if base.max_range_m is None:
        return log
    inside = log.distance_m <= base.max_range_m
    if log.delivered[~inside].any():
        farthest = float(np.max(log.distance_m[log.delivered]))
        raise ChannelInputError(
            "max_range_m", base.max_range_m, f"null, or beyond {farthest:g} m, where a packet arrived"
        )
    return log.part(inside)


def _check(log: FlightLog, base: RadioConfig) -> None:
    _check_base(base)
    delivered = int(np.count_nonzero(log.delivered))
    powers = int(np.count_nonzero(log.delivered & np.isfinite(log.rssi_dbm)))
    if log.packets < MIN_PACKETS:
        raise NotEnoughInformationError(f"{log.packets} packets: at least {MIN_PACKETS} are needed")
    if delivered == 0:
        raise NotEnoughInformationError(
            f"none of {log.packets} packets arrived: fly nearer, until some arrive"
        )
    if delivered == log.packets and powers < MIN_PACKETS:
        raise NotEnoughInformationError(
            f"all {delivered} packets arrived, and their powers are not known: fly farther, until some are lost"
        )
    if float(np.ptp(np.log(np.maximum(log.distance_m, base.min_distance_m)))) < 1e-3:
        raise NotEnoughInformationError(
            "all packets were sent at one distance: fly along a range of distances"
        )


def _check_base(base: RadioConfig) -> None:
    """Refuse a base with terms that a fit does not take into account."""
    for name, value, allowed in (
        ("propagation.model", getattr(base.propagation, "model", "own"), ("log-distance",)),
        ("shadowing.model", base.shadowing.model, ("normal", "one-sided-normal", "gudmundson")),
        ("fading.model", getattr(base.fading, "model", "own"), ("none",)),
        ("bursts.model", base.bursts.model, ("none",)),
        ("atmosphere.model", base.atmosphere.model, ("none",)),
    ):
        if value not in allowed:
            raise ChannelInputError(name, value, f"{' or '.join(allowed)}, to fit a radio from")
    if base.interference.interferers:
        raise ChannelInputError(
            "interference.interferers", len(base.interference.interferers), "none, to fit"
        )


def _free(likelihood: Likelihood, held: frozenset[str]) -> Mask:
    """Return what is to be fitted. Without RSSI only the difference of offset and noise floor shows: one is given."""
    free = np.array([name not in held for name in ALL_NAMES])
    free[ERROR] = likelihood.has_rssi
    if not likelihood.has_rssi:
        free[FLOOR] &= not free[OFFSET]
    return free


Ends = dict[int, tuple[float, float]]


class _Top(NamedTuple):
    """The highest place, and the best there is at each of many exponents."""

    best: Point
    ridge: list[Point]


def _top(likelihood: Likelihood, free: Mask) -> _Top:
    """Return the maximum."""
    best = _climb_from_everywhere(likelihood, free)
    ridge = _ridge(likelihood, best, free)
    best = max(
        (best, *(climb(likelihood, point.at, free) for point in ridge if point.value > best.value)),
        key=_value,
    )
    return _Top(best, ridge)


def _intervals(likelihood: Likelihood, free: Mask, top: _Top) -> tuple[Point, Ends]:
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


def _climb_from_everywhere(likelihood: Likelihood, free: Mask) -> Point:
    """Return the best of the maxima that several starts lead to."""
    known = likelihood.natural(likelihood.base_values)
    exponents = STARTS_EXPONENT if free[EXPONENT] else (float(known[EXPONENT]),)
    sigmas_db = STARTS_SIGMA_DB if free[SIGMA] else (float(known[SIGMA]),)
    starts = [
        np.where(free, start, likelihood.base_values) for start in likelihood.starts(exponents, sigmas_db)
    ]
    starts.sort(key=lambda start: likelihood.point(start).value, reverse=True)
    return max(
        (climb(likelihood, start, free) for start in starts[:MOST_STARTS]), key=lambda each: each.value
    )


def _ridge(likelihood: Likelihood, best: Point, free: Mask) -> list[Point]:
    """Return the best there is at each of many exponents.

    Without RSSI a steep law with much shadowing is nearly as likely as a flat one with little: the likelihood is a
    long ridge, on which a search that starts at its highest point may not come far.
    """
    if likelihood.has_rssi or not free[EXPONENT]:
        return []
    known = likelihood.natural(likelihood.base_values)
    sigmas_db = STARTS_SIGMA_DB if free[SIGMA] else (float(known[SIGMA]),)
    others = free.copy()
    others[EXPONENT] = False
    points = []
    for exponent in RIDGE_EXPONENTS:
        starts = [*likelihood.starts((exponent,), sigmas_db), likelihood.at_exponent(best.at, exponent)]
        allowed = (np.where(free, likelihood.inside(at), likelihood.base_values) for at in starts)
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
        note = "as given" if name in held else f"without RSSI it cannot be told apart from {_twin(name)}"
        return Estimate(name, None, -math.inf, math.inf, f"{note}: the base radio's")
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


def _settled(likelihood: Likelihood, best: Point, free: Mask, estimates: tuple[Estimate, ...]) -> Parameters:
    """Return the values for a radio: what the data do not determine is the base's, the rest the best beside it."""
    determined = _determined(free, estimates)
    values = np.where(determined, best.at, likelihood.base_values)
    if not determined[: len(NAMES)].any() or (determined == free).all():
        return values
    return climb(likelihood, values, determined).at
