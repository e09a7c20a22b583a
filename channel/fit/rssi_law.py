"""How measured received powers scatter about their mean: a law of bins, because a receiver reports whole steps.

The loss is a normal shadowing, or a one-sided one, with a receiver's own normal error on top. The chance of a bin is a
difference of distribution functions: exact for rounded readings, and regular even where the density has an edge.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.special import log_ndtr, ndtr, owens_t

from channel.checks import FloatArray

OWN_BIN_DB = 1.0
"""Readings finer than this are sorted into bins this wide: it costs next to nothing and keeps the likelihood smooth."""
FINEST_STEP_DB = 0.25
WIDEST_STEP_DB = 3.0
OUTLIERS = 1e-9
"""Added to each chance, so that one reading that fits nothing does not decide a fit."""
_SQRT_2PI = math.sqrt(2.0 * math.pi)


class BinChance(NamedTuple):
    """Chance of each bin, and its derivatives by residual, sigma and the receiver's error, per dB."""

    chance: FloatArray
    by_residual: FloatArray
    by_sigma: FloatArray
    by_error: FloatArray


class TruePower(NamedTuple):
    """The power that was there, given a reading: the reading plus `shift`, and a normal spread about it, dB.

    Attributes:
        shift: mean, less the reading; with its derivatives by residual, sigma and error.
        spread: standard deviation far from the edge; with its derivatives by sigma and error.
        share: of the variance that the edge leaves; with its derivatives by residual, sigma and error.
    """

    shift: tuple[FloatArray, FloatArray, FloatArray, FloatArray]
    spread: tuple[float, float, float]
    share: tuple[FloatArray, FloatArray, FloatArray, FloatArray] | None


def true_power(residual_db: FloatArray, sigma_db: float, error_db: float, *, one_sided: bool) -> TruePower:
    """Return what a reading says of the power, by Bayes: two normal laws, cut off at the edge of a one-sided one.

    Moments of the normal law cut off above: Johnson, Kotz, Balakrishnan, Continuous Univariate Distributions 1, 13.10.
    """
    variance = sigma_db**2 + error_db**2
    root = math.sqrt(variance)
    spread = sigma_db * error_db / root
    by_sigma, by_error = (error_db / root) ** 3, (sigma_db / root) ** 3
    lost = error_db**2 / variance  # 1 - k of the weight that the reading has
    turn = 2.0 * sigma_db * error_db / variance**2
    shift = -lost * residual_db
    slopes = np.full_like(residual_db, -lost), turn * error_db * residual_db, -turn * sigma_db * residual_db
    if not one_sided:
        return TruePower((shift, *slopes), (spread, by_sigma, by_error), None)
    steep = sigma_db / (error_db * root)
    edge = np.clip(-steep * residual_db, -200.0, 200.0)
    edge_slopes = (
        np.full_like(residual_db, -steep),
        -residual_db * error_db / (variance * root),
        residual_db * sigma_db * (variance + error_db**2) / (error_db**2 * variance * root),
    )
    mills = np.exp(-0.5 * edge**2 - log_ndtr(edge)) / _SQRT_2PI
    mills_slope = -mills * (edge + mills)
    share = np.clip(1.0 - edge * mills - mills**2, 0.0, 1.0)
    share_slope = -mills - edge * mills_slope - 2.0 * mills * mills_slope
    cut = [
        old - spread_slope * mills - spread * mills_slope * slope
        for old, spread_slope, slope in zip(slopes, (0.0, by_sigma, by_error), edge_slopes, strict=True)
    ]
    return TruePower(
        (shift - spread * mills, cut[0], cut[1], cut[2]),
        (spread, by_sigma, by_error),
        (share, share_slope * edge_slopes[0], share_slope * edge_slopes[1], share_slope * edge_slopes[2]),
    )


def step_of(rssi_dbm: FloatArray) -> float:
    """Return the step of a grid between 0.25 and 3 dB that all readings lie on, dB; 0 if there is none."""
    levels = np.unique(np.round(rssi_dbm, 6))
    for step_db in (1.0, float(np.min(np.diff(levels), initial=np.inf))):
        if FINEST_STEP_DB <= step_db <= WIDEST_STEP_DB:
            steps = (levels - levels[0]) / step_db
            if np.all(np.abs(steps - np.round(steps)) < 0.02 * np.maximum(1.0, 0.05 * steps)):
                return step_db
    return 0.0


def bins_of(rssi_dbm: FloatArray) -> tuple[FloatArray, float]:
    """Return the centres of the bins that readings lie in, and the width of a bin, dB.

    Readings that all lie on a grid of steps between 0.25 and 3 dB keep it; others go into bins of 1 dB.
    """
    step_db = step_of(rssi_dbm)
    if step_db > 0.0:
        return np.array(rssi_dbm), step_db
    return (np.floor(rssi_dbm / OWN_BIN_DB) + 0.5) * OWN_BIN_DB, OWN_BIN_DB


def normal_bins(residual_db: FloatArray, width_db: float, sigma_db: float, error_db: float) -> BinChance:
    """Return the law of bins for normal shadowing and a normal error; residual is the centre less the mean power."""
    sigma = math.hypot(sigma_db, error_db)
    sign = np.where(residual_db > 0.0, -1.0, 1.0)  # both ends on the lower side, where differences are exact
    middle = sign * residual_db / sigma
    half = width_db / (2.0 * sigma)
    upper, lower = middle + half, middle - half
    chance = ndtr(upper) - ndtr(lower) + OUTLIERS
    at_upper, at_lower = _density(upper), _density(lower)
    by_residual = sign * (at_upper - at_lower) / sigma
    by_spread = -(upper * at_upper - lower * at_lower) / sigma**2
    return BinChance(chance, by_residual, by_spread * sigma_db, by_spread * error_db)


def one_sided_bins(residual_db: FloatArray, width_db: float, sigma_db: float, error_db: float) -> BinChance:
    """Return the law of bins for -sigma |z| + error w, z and w standard normal: a skew normal law (Azzalini 1985).

    F(x) = Phi(x / s) + 2 T(x / s, sigma / error), s^2 = sigma^2 + error^2, T Owen's function.
    """
    upper = _skew_normal(residual_db + width_db / 2.0, sigma_db, error_db)
    lower = _skew_normal(residual_db - width_db / 2.0, sigma_db, error_db)
    chance, *slopes = (high - low for high, low in zip(upper, lower, strict=True))
    return BinChance(np.maximum(chance, 0.0) + OUTLIERS, *slopes)


def share_below(x_db: FloatArray, sigma_db: float, error_db: float, *, one_sided: bool) -> FloatArray:
    """Return the distribution function of a power less its mean: of the shadowing and the receiver's error together."""
    if one_sided:
        return _skew_normal(x_db, sigma_db, error_db)[0]
    return np.asarray(ndtr(x_db / math.hypot(sigma_db, error_db)))


def van_der_corput(count: int) -> FloatArray:
    """Return the first terms of van der Corput's sequence of base 2: evenly over (0, 1), in no order (1935)."""
    index, out, share = np.arange(1, count + 1), np.zeros(count), 0.5
    while index.any():
        out += share * (index & 1)
        index, share = index >> 1, 0.5 * share
    return out


def _skew_normal(
    x_db: FloatArray, sigma_db: float, error_db: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the distribution function and its derivatives by x, sigma and error."""
    variance = sigma_db**2 + error_db**2
    spread = math.sqrt(variance)
    at = x_db / spread
    below = ndtr(at) + 2.0 * owens_t(at, sigma_db / error_db)
    density = 2.0 / spread * _density(at) * ndtr(-at * (sigma_db / error_db))
    edge = np.exp(-0.5 * (x_db / error_db) ** 2) / (math.pi * variance)
    drift = -density * x_db / variance
    return below, density, drift * sigma_db + error_db * edge, drift * error_db - sigma_db * edge


def _density(z: FloatArray) -> FloatArray:
    out: FloatArray = np.exp(-0.5 * z * z) / _SQRT_2PI
    return out
