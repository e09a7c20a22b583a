"""Fitting a radio to a flight log by maximum likelihood, with profile-likelihood intervals.

What is fitted: the exponent of a log-distance law, an offset of the received power, the spread of the shadowing and
the base loss; with received powers (RSSI) in the log also the noise floor. The error model is the base radio's.

The likelihood of a packet without RSSI is Bernoulli with the closed probability of delivery. A delivered packet with
RSSI r adds the density of r and the probability of delivery at r. Intervals hold the values whose profile deviance
is below the chi-squared quantile (Wilks); for the one-sided shadowing with RSSI, whose density has an edge that
moves with the parameters, below that of two degrees of freedom (Smith, Biometrika 72 (1985)).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from channel.checks import ChannelInputError, FloatArray
from channel.config import RadioConfig
from channel.flight_log import FlightLog
from channel.likelihood import LIMITS, NAMES, RSSI_ERROR_DB, Likelihood, Parameters
from channel.presets import merged, radio_from_mapping

CHI2_95 = {1: 3.841458820694124, 2: 5.991464547107979}
MIN_PACKETS = 20
MAX_ITERATIONS = 40
TOLERANCE = 1e-3
ROOT_TOLERANCE = 0.03
DIFFERENCE = 1e-4
LEAST_DAMPING = 1e-8
"""Small: exponent and offset hang together so closely that a little more would stop the climb along their ridge."""
DAMPINGS = 9
RESTARTS = 12
HIGHER = 0.02
"""By how much a likelihood has to be above the maximum for the climb to start anew from there."""
ROUGH_ERRORS_DB = (4.0, 1.0)
PROFILE_STEPS = 30
STARTS_SIGMA_DB = (1.0, 4.0, 9.0)
STARTS_EXPONENT = (2.0, 3.5, 6.0, 12.0)


Mask = NDArray[np.bool_]


class _HigherError(Exception):
    """The search for the end of an interval came higher than the maximum it started from."""

    def __init__(self, point: Parameters) -> None:
        super().__init__("not the maximum")
        self.point = point


class NotEnoughInformationError(ValueError):
    """A log from which nothing can be fitted; the message says what it lacks."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """One parameter.

    Attributes:
        name: as in the radio's configuration.
        value: the most likely one, or None if the data do not determine it.
        low: lower end of the 95 % interval; -inf if the data set none.
        high: upper end; inf if the data set none.
        note: what the data say of it, if not all.
    """

    name: str
    value: float | None
    low: float
    high: float
    note: str = ""


@dataclass(frozen=True, slots=True)
class Fit:
    """A fitted radio.

    Attributes:
        estimates: one per parameter.
        log_likelihood: at the maximum.
        packets: in the log.
        delivered: of these.
        overrides: what to lay over the base radio: the fitted values, the base's where nothing was determined.
    """

    estimates: tuple[Estimate, ...]
    log_likelihood: float
    packets: int
    delivered: int
    overrides: Mapping[str, Any]


def fit_radio(log: FlightLog, base: RadioConfig, hold: Iterable[str] = ()) -> Fit:
    """Fit a radio to a log.

    Args:
        log: of one link or of many with the same radio.
        base: gives the error model, powers, gains, kind of shadowing, and what the data do not determine. Its
            propagation has to be log-distance and its shadowing normal or one-sided normal.
        hold: names of parameters that are known, and stay the base's.

    Raises:
        NotEnoughInformationError: too few packets, all or none delivered, or all at one distance.
        ChannelInputError: a base of another kind.
    """
    _check(log, base)
    likelihood = Likelihood(log, base)
    free = np.ones(len(NAMES), dtype=bool)
    free[NAMES.index("noise.floor_dbm")] = likelihood.has_rssi
    held = frozenset(hold)
    if not held <= set(NAMES):
        raise ChannelInputError("hold", sorted(held - set(NAMES)), f"names among {', '.join(NAMES)}")
    free &= [name not in held for name in NAMES]
    best, height = _climb_from_everywhere(likelihood, free)
    degrees = 2 if likelihood.has_edge else 1
    for restarts_left in range(RESTARTS, -1, -1):
        ceiling = height + HIGHER if restarts_left else math.inf
        try:
            estimates = [
                _estimate(likelihood, i, best, height, free, CHI2_95[degrees], ceiling)
                if free[i]
                else _held(i, held)
                for i in range(len(NAMES))
            ]
            break
        except _HigherError as higher:
            best, height = _climb(likelihood, higher.point, free)
    determined = np.array([estimate.value is not None for estimate in estimates])
    if not determined[free].all() and determined.any():
        known = np.where(determined, best, likelihood.base_values)
        best, _ = _climb(likelihood, known, determined & free)
    else:
        best = np.where(determined, best, likelihood.base_values)
    return Fit(
        estimates=tuple(estimates),
        log_likelihood=height,
        packets=log.packets,
        delivered=int(np.count_nonzero(log.delivered)),
        overrides=likelihood.overrides(best),
    )


def fitted_radio(fit: Fit, base: RadioConfig, name: str) -> RadioConfig:
    """Return the base radio with the fitted values laid over it, under a name."""
    tree = merged(base.model_dump(mode="json", by_alias=True, exclude_none=True), fit.overrides)
    tree |= {
        "name": name,
        "description": f"{base.name}, fitted to {fit.packets} packets of which {fit.delivered} arrived",
        "source": "lostlink fit",
    }
    return radio_from_mapping(tree)


def _check(log: FlightLog, base: RadioConfig) -> None:
    if base.propagation.model != "log-distance":
        raise ChannelInputError(
            "propagation.model", base.propagation.model, "log-distance, to fit a radio from"
        )
    if base.shadowing.model not in {"normal", "one-sided-normal"}:
        raise ChannelInputError(
            "shadowing.model", base.shadowing.model, "normal or one-sided-normal, to fit from"
        )
    delivered = int(np.count_nonzero(log.delivered))
    if log.packets < MIN_PACKETS:
        raise NotEnoughInformationError(f"{log.packets} packets: at least {MIN_PACKETS} are needed")
    if delivered == log.packets:
        raise NotEnoughInformationError(f"all {delivered} packets arrived: fly farther, until some are lost")
    if delivered == 0:
        raise NotEnoughInformationError(
            f"none of {log.packets} packets arrived: fly nearer, until some arrive"
        )
    if float(np.ptp(np.log(log.distance_m))) < 1e-3:
        raise NotEnoughInformationError(
            "all packets were sent at one distance: fly along a range of distances"
        )


def _climb_from_everywhere(likelihood: Likelihood, free: Mask) -> tuple[FloatArray, float]:
    """Return the best of the maxima that several starts lead to."""
    tries = set()
    for exponent in STARTS_EXPONENT:
        for sigma_db in STARTS_SIGMA_DB:
            start = np.where(free, likelihood.start(exponent, sigma_db), likelihood.base_values)
            tries.add((likelihood.log_likelihood(start), tuple(start)))
    maxima = [
        _descend_errors(likelihood, np.asarray(start), free) for _, start in sorted(tries, reverse=True)[:3]
    ]
    return max(maxima, key=lambda each: each[1])


def _descend_errors(likelihood: Likelihood, start: FloatArray, free: Mask) -> tuple[FloatArray, float]:
    """Return the maximum, reached by way of those for greater errors of RSSI, whose laws have no sharp edge."""
    here, height = start, -math.inf
    for error_db in (*ROUGH_ERRORS_DB, RSSI_ERROR_DB) if likelihood.has_edge else (RSSI_ERROR_DB,):
        likelihood.rssi_error_db = error_db
        here, height = _climb(likelihood, here, free)
    return here, height


def _climb(likelihood: Likelihood, start: FloatArray, free: Mask) -> tuple[FloatArray, float]:
    """Return the maximum over the free parameters: Fisher scoring, damped as Levenberg's."""
    here, damping = np.array(start), LEAST_DAMPING
    height = likelihood.log_likelihood(here)
    for _ in range(MAX_ITERATIONS):
        gradient, information = _scoring(likelihood, here, free)
        scale = np.diag(np.maximum(np.diag(information), 1e-9))
        for _ in range(DAMPINGS):
            step = np.zeros_like(here)
            step[free] = np.linalg.solve(information + damping * scale, gradient)
            there = likelihood.inside(here + step)
            new = likelihood.log_likelihood(there)
            if new > height:
                break
            damping *= 30.0
        else:
            return here, height
        gained, here, height, damping = new - height, there, new, max(damping / 900.0, LEAST_DAMPING)
        if gained < TOLERANCE:
            break
    return here, height


def _scoring(likelihood: Likelihood, here: FloatArray, free: Mask) -> tuple[FloatArray, FloatArray]:
    """Return the gradient and the Fisher information of the free parameters.

    A Bernoulli packet's information is its squared score times the odds of what happened; with a measured power
    the squared score itself stands in (Berndt, Hall, Hall, Hausman 1974).
    """
    at_here = likelihood.per_packet(here)
    columns = []
    for i in np.flatnonzero(free):
        shift = np.zeros_like(here)
        shift[i] = DIFFERENCE
        columns.append((likelihood.per_packet(here + shift) - at_here) / DIFFERENCE)
    scores = np.stack(columns, axis=-1)
    chance = np.minimum(at_here, -1e-9)
    odds = np.where(likelihood.with_rssi, 1.0, np.exp(chance) / -np.expm1(chance))
    return scores.sum(axis=0), scores.T @ (scores * odds[:, np.newaxis])


def _estimate(
    likelihood: Likelihood,
    index: int,
    best: Parameters,
    height: float,
    free: Mask,
    threshold: float,
    ceiling: float,
) -> Estimate:
    low, high = (
        _profile_end(likelihood, index, best, height, free, threshold, ceiling, sign) for sign in (-1.0, 1.0)
    )
    name = NAMES[index]
    if name in {"shadowing.sigma_db", "base_loss"} and low == -math.inf:
        low = LIMITS[name][0]
    if math.isinf(low) or math.isinf(high):
        return Estimate(name, None, low, high, "the data do not determine it")
    return Estimate(name, float(likelihood.natural(best)[index]), low, high)


def _held(index: int, held: frozenset[str]) -> Estimate:
    name = NAMES[index]
    note = "as given" if name in held else "without RSSI it cannot be told apart from offset_db"
    return Estimate(name, None, -math.inf, math.inf, f"{note}: the base radio's")


def _profile_end(
    likelihood: Likelihood,
    index: int,
    best: Parameters,
    height: float,
    free: Mask,
    threshold: float,
    ceiling: float,
    sign: float,
) -> float:
    """Return where the profile deviance crosses the threshold on one side; infinite if nowhere within the limits.

    The root of the deviance is nearly linear in the parameter: steps follow the secant, kept within the bracket.
    """
    others = free.copy()
    others[index] = False
    limit, goal = likelihood.limit(index, sign), math.sqrt(threshold)
    inside, inside_root, outside, outside_root = float(best[index]), 0.0, math.nan, math.nan
    near, step = best, likelihood.scale(index, best)
    way = _way(likelihood, index, best, free)
    for _ in range(PROFILE_STEPS):
        target = (
            inside + sign * step
            if math.isnan(outside)
            else _between(inside, inside_root, outside, outside_root, goal)
        )
        hit = sign * (target - limit) >= 0.0
        there, value = _climb(
            likelihood, _start(likelihood, index, near, limit if hit else target, way), others
        )
        if value > ceiling:
            raise _HigherError(there)
        root = math.sqrt(max(2.0 * (height - value), 0.0))
        at = float(there[index])
        if root > goal:
            outside, outside_root = at, root
        elif hit or likelihood.at_limit(there, others):
            return sign * math.inf
        else:
            step = min(
                max(1.2 * abs(at - inside) * (goal - root) / max(root - inside_root, 0.02), 1.2 * step),
                3.0 * step,
            )
            inside, inside_root, near = at, root, there
        if abs(root - goal) < ROOT_TOLERANCE:
            break
    found = np.array(best)
    found[index] = outside if not math.isnan(outside) else inside
    return float(likelihood.natural(found)[index])


def _way(likelihood: Likelihood, index: int, best: Parameters, free: Mask) -> FloatArray:
    """Return how the other free parameters go with one of them near the maximum, by the information there."""
    _, information = _scoring(likelihood, best, free)
    place = int(np.count_nonzero(free[:index]))
    rest = np.delete(information[place], place)
    square = np.delete(np.delete(information, place, axis=0), place, axis=1)
    along = -np.linalg.lstsq(square, rest, rcond=1e-10)[0]
    way = np.zeros_like(best)
    way[free] = np.insert(along, place, 1.0)
    return way


def _start(
    likelihood: Likelihood, index: int, near: Parameters, target: float, way: FloatArray
) -> Parameters:
    """Return the better of two points with one coordinate at the target from which to climb in the others."""
    straight = likelihood.inside(near + (target - near[index]) * way)
    slid = likelihood.slid(near, index, target)
    return max((straight, slid), key=likelihood.log_likelihood)


def _between(inside: float, inside_root: float, outside: float, outside_root: float, goal: float) -> float:
    """Return where the straight line between two ends of a bracket meets the goal, away from the ends."""
    share = (goal - inside_root) / max(outside_root - inside_root, 1e-12)
    return inside + min(max(share, 0.05), 0.95) * (outside - inside)
