"""Fitting a radio to a flight log.

What is fitted: the exponent of a log-distance law, an offset of the received power, the spread of the shadowing and the
base loss; with received powers (RSSI) in the log also the noise floor and, if the residuals show that shadowing is
correlated along the track, its decorrelation distance, and K if packets fade. The error model is the base radio's. With
RSSI the receiver's own error of it is fitted along: it blurs at which power packets get lost, and the edge of one-sided
shadowing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from channel.checks import ChannelInputError, FloatArray
from channel.config import RadioConfig
from channel.fading.shadowing import OneSidedNormalShadowing
from channel.fit.correlated.fit import DECORRELATION_NAME, K_NAME, CorrelatedFit
from channel.fit.correlated.search import FLOOR as FLOOR_COORDINATE
from channel.fit.flight_log import FlightLog
from channel.fit.independent import free_parameters, highest, independent_fit
from channel.fit.likelihood import (
    ALL_NAMES,
    LIMITS,
    NAMES,
    Likelihood,
)
from channel.fit.residuals import DEPENDENT, along, chance_of_independence
from channel.fit.result import GIVEN, Estimate, Fit, Goodness
from channel.presets import merged, radio_from_mapping

MIN_PACKETS = 20


class NotEnoughInformationError(ValueError):
    """A log from which nothing can be fitted; the message says what it lacks."""


ONE_SIDED_NOTE = (
    "neighbouring packets depend on each other, which one-sided shadowing has no law for: an interval would be too "
    "narrow; try --set shadowing.model=normal"
)
NO_RSSI_NOTE = (
    "neighbouring packets depend on each other, and without RSSI the extent is unknown: an interval would be too "
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
    free = free_parameters(likelihood, held)
    top = highest(likelihood, free, likelihood.base_values)
    independent = chance_of_independence(likelihood.scores(top.best.at), along(log.distance_m, log.link))
    if independent > DEPENDENT:
        return independent_fit(log, base, likelihood, free, held, top, independent)
    one_sided = isinstance(base.shadowing, OneSidedNormalShadowing)
    if one_sided or not likelihood.has_rssi:
        fit = independent_fit(log, base, likelihood, free, held, top, independent)
        fit = replace(fit, goodness=Goodness(None, None, None, independent))
        return _without_intervals(fit, ONE_SIDED_NOTE if one_sided else NO_RSSI_NOTE)
    return _correlated_fit(log, base, likelihood.natural(top.best.at)[: len(NAMES)], held, independent)


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
    if fit.faded:
        overrides["fading"] = {"model": "rician", "k_db": values[K_NAME], "coherence": "doppler"}
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
        goodness=Goodness(left.independence, None if fit.faded else left.readings, None, independent),
    )
    if left.independence is not None and left.independence < DEPENDENT:
        return _without_intervals(out, PLACES_NOTE)
    return out


def _without_intervals(fit: Fit, why: str) -> Fit:
    """Return a fit that claims nothing of what it fitted: its intervals would be too narrow."""
    estimates = tuple(
        Estimate(each.name, None, -math.inf, math.inf, each.note if each.note.endswith(GIVEN) else why)
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
        (
            "shadowing.model",
            getattr(base.shadowing, "model", "own"),
            ("normal", "one-sided-normal", "gudmundson"),
        ),
        ("fading.model", getattr(base.fading, "model", "own"), ("none",)),
        ("bursts.model", getattr(base.bursts, "model", "own"), ("none",)),
        ("atmosphere.model", base.atmosphere.model, ("none",)),
    ):
        if value not in allowed:
            raise ChannelInputError(name, value, f"{' or '.join(allowed)}, to fit a radio from")
    if base.interference.interferers:
        raise ChannelInputError(
            "interference.interferers", len(base.interference.interferers), "none, to fit"
        )
