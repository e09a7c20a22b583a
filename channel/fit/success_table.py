"""Probability that a packet arrives, tabulated for fits: by SNR, and by mean SNR averaged over the shadowing."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.fading.shadowing import normal_below, one_sided_below
from channel.link.expectation import averaged_over_loss
from channel.phy.error_model import Band, ErrorModel

STEP_DB = 0.1
SNR_DB = np.arange(-250.0, 250.0, STEP_DB)
"""Where the table has its columns. All error models go from 0 to 1 well within."""
SMALL_SIGMA_DB = 0.5
"""Below it the average goes linearly with the variance: exact to its second order, and with a slope at 0."""
ROOT_STEP = 0.125
ROOTS = np.arange(0.0, math.sqrt(30.0) + 2.0 * ROOT_STEP, ROOT_STEP)
"""Square roots of sigma of the table's rows: narrow ones, where the average turns fastest, lie densely."""
LEAST_ROOT = 0.05
LEAST_SIGMA_DB = 1e-3


class SuccessTable:
    """1 - PER of one error model at one length.

    Args:
        error: the error model.
        length_bytes: as the error model counts it.
        band: noise bandwidth and bit rate.
        one_sided: whether the shadowing can only cost.
        bin_db: 1 - PER is averaged over a bin of this width first, dB; 0: as it is.
    """

    def __init__(
        self, error: ErrorModel, length_bytes: float, band: Band, *, one_sided: bool, bin_db: float = 0.0
    ) -> None:
        success = 1.0 - error.per(SNR_DB, length_bytes, band)
        self._success = success if bin_db == 0.0 else _in_bins(success, bin_db)
        self._one_sided = one_sided
        self._rows: dict[int, FloatArray] = {}
        self._below = one_sided_below if one_sided else normal_below

    def averaged(self, snr_db: FloatArray, sigma_db: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return E[1 - PER] over the shadowing at each mean SNR, and its derivatives by SNR and sigma, per dB."""
        if sigma_db < SMALL_SIGMA_DB and not self._one_sided:
            return self._nearly_unshadowed(snr_db, max(sigma_db, LEAST_SIGMA_DB))
        mean, by_sigma = self._curve(sigma_db)
        value, by_snr = _with_slope(mean, snr_db)
        return np.clip(value, 0.0, 1.0), by_snr, _at(by_sigma, snr_db)

    def _nearly_unshadowed(
        self, snr_db: FloatArray, sigma_db: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        share = (sigma_db / SMALL_SIGMA_DB) ** 2
        change = self._curve(SMALL_SIGMA_DB)[0] - self._success
        value, by_snr = _with_slope(self._success + share * change, snr_db)
        return value, by_snr, _at(change * (2.0 * share / sigma_db), snr_db)

    def _curve(self, sigma_db: float) -> tuple[FloatArray, FloatArray]:
        """Return the averages at all mean SNRs of the table, and their derivatives by sigma."""
        root = min(max(math.sqrt(sigma_db), LEAST_ROOT), float(ROOTS[-1]))
        at = root / ROOT_STEP
        first = min(max(int(at) - 1, 0), len(ROOTS) - 4)
        rows = np.stack([self._row(first + i) for i in range(4)])
        weights, slopes = _cubic(at - first)
        return weights @ rows, (slopes @ rows) / (ROOT_STEP * 2.0 * root)

    def _row(self, index: int) -> FloatArray:
        """Return E[1 - PER] for one sigma at all mean SNRs of the table."""
        row = self._rows.get(index)
        if row is None:
            sigma_db = float(ROOTS[index]) ** 2
            row = averaged_over_loss(self._success, STEP_DB, partial(self._below, sigma_db=sigma_db))
            self._rows[index] = row
        return row


def _in_bins(success: FloatArray, bin_db: float) -> FloatArray:
    """Return 1 - PER averaged over a bin about each SNR of the table."""
    integral = np.concatenate(([0.0], np.cumsum(0.5 * STEP_DB * (success[1:] + success[:-1]))))
    low, high = SNR_DB - 0.5 * bin_db, SNR_DB + 0.5 * bin_db
    beyond = np.maximum(high - SNR_DB[-1], 0.0) * success[-1]
    out: FloatArray = (_at(integral, high) + beyond - _at(integral, low)) / bin_db
    return out


def _place(snr_db: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
    """Return the column to the left of each SNR and how far beyond it the SNR lies, in steps."""
    at = np.clip((snr_db - SNR_DB[0]) / STEP_DB, 0.0, SNR_DB.size - 1.000001)
    left = at.astype(np.intp)
    return left, at - left


def _at(row: FloatArray, snr_db: FloatArray) -> FloatArray:
    left, part = _place(snr_db)
    here = row[left]
    return here + part * (row[left + 1] - here)


def _with_slope(row: FloatArray, snr_db: FloatArray) -> tuple[FloatArray, FloatArray]:
    left, part = _place(snr_db)
    here, rise = row[left], row[left + 1] - row[left]
    return here + part * rise, rise / STEP_DB


def _cubic(at: float) -> tuple[FloatArray, FloatArray]:
    """Return the weights of Lagrange's cubic through values at 0, 1, 2 and 3, for its value and slope at `at`."""
    a, b, c, d = at, at - 1.0, at - 2.0, at - 3.0
    value = np.array([-b * c * d / 6.0, a * c * d / 2.0, -a * b * d / 2.0, a * b * c / 6.0])
    slope = np.array(
        [
            -(c * d + b * d + b * c) / 6.0,
            (c * d + a * d + a * c) / 2.0,
            -(b * d + a * d + a * b) / 2.0,
            (b * c + a * c + a * b) / 6.0,
        ]
    )
    return value, slope
