"""What the arrival or loss of a packet says of its power, when that is known up to a normal law."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.fading.shadowing import normal_below
from channel.fit.correlated.law import Law
from channel.link.expectation import averaged_over_loss
from channel.phy.error_model import Band, ErrorModel

FINE_DB = 0.1
KEPT = 3
"""One in so many of the fine SNRs has a column."""
FINE_SNR_DB = np.arange(-150.0, 150.0, FINE_DB)
SNR_DB = FINE_SNR_DB[::KEPT]
STEP_DB = KEPT * FINE_DB
ROOT_STEP = 0.125
ROOTS = np.arange(0.0, 5.0 + ROOT_STEP, ROOT_STEP)
"""Square roots of the deviations in dB that have a row: dense where the average turns fastest."""
LEAST_FLOAT = 1e-300
LEAST_CHANCE = 1e-12
"""Below it the logarithm goes on along its slope, so that a search finds back."""


class Said(NamedTuple):
    """Log of the chance of what happened, its slope by the mean power, and the negative of its curvature."""

    log: FloatArray
    slope: FloatArray
    bend: FloatArray


class Outcomes:
    """Chances of arrival and loss averaged over normal laws of the SNR, and their derivatives, looked up.

    Args:
        error: the error model.
        band: noise bandwidth and bit rate.
        lengths: those that occur, as the error model counts them.
        length: which of them each packet has, shape (packets,).
        delivered: whether each packet arrived.
    """

    def __init__(
        self,
        error: ErrorModel,
        band: Band,
        lengths: Sequence[float],
        length: NDArray[np.intp],
        delivered: NDArray[np.bool_],
    ) -> None:
        tables = []
        for each in lengths:
            lost = error.per(FINE_SNR_DB, each, band)
            tables += [_logs(1.0 - lost, rising=True), _logs(lost, rising=False)]
        self._rows = np.array(tables).reshape(-1, 3)
        self._first = (2 * length + ~delivered) * (ROOTS.size * SNR_DB.size)
        self._lost = np.flatnonzero(~delivered)
        self._arrived = np.flatnonzero(delivered)

    def said(self, snr_db: FloatArray, variance: FloatArray, law: Law) -> Said:
        """Return what each packet says, for normal laws of its SNR."""
        return self._with_base_loss(looked_up(self._rows, self._first, snr_db, variance), law.base_loss)

    def first(self, _law: Law, /) -> tuple[FloatArray, FloatArray]:
        """Return weight and mean SNR of the normal factors to begin with: none."""
        return np.zeros(self._first.size), np.zeros(self._first.size)

    def _with_base_loss(self, said: Said, base_loss: float) -> Said:
        """Return what packets say if some of them are lost whatever their SNR; changes what it was given."""
        kept, lost = 1.0 - base_loss, self._lost
        log, slope, bend = said
        log[self._arrived] += np.log(kept)
        missed = kept * np.exp(np.minimum(log[lost], 0.0))
        share = missed / np.maximum(missed + base_loss, LEAST_FLOAT)
        bend[lost] = share * (bend[lost] - (1.0 - share) * slope[lost] ** 2)
        slope[lost] *= share
        log[lost] = np.where(base_loss > 0.0, np.log(np.maximum(missed + base_loss, LEAST_FLOAT)), log[lost])
        return said


def looked_up(rows: FloatArray, first: NDArray[np.intp], snr_db: FloatArray, variance: FloatArray) -> Said:
    """Return what tables say, linear between their SNRs and roots.

    Args:
        rows: log, slope and curvature, of all tables by root and SNR one after the other, shape (all, 3).
        first: where each packet's table begins.
        snr_db: mean of each packet's.
        variance: of each packet's SNR.
    """
    column = np.clip((snr_db - SNR_DB[0]) / STEP_DB, 0.0, SNR_DB.size - 1.000001)
    row = np.clip(variance**0.25 / ROOT_STEP, 0.0, ROOTS.size - 1.000001)
    left, lower = column.astype(np.intp), row.astype(np.intp)
    right, upper = (column - left)[:, np.newaxis], (row - lower)[:, np.newaxis]
    at = first + lower * SNR_DB.size + left
    below = rows.take(at, axis=0)
    below += right * (rows.take(at + 1, axis=0) - below)
    at += SNR_DB.size
    above = rows.take(at, axis=0)
    above += right * (rows.take(at + 1, axis=0) - above)
    log, slope, curve = (below + upper * (above - below)).T.copy()
    return Said(log, slope, -curve)


def _logs(chance: FloatArray, *, rising: bool) -> FloatArray:
    """Return the log of a chance averaged over normal laws, its slope and curvature: shape (deviations, SNRs, 3)."""
    rows = np.stack([_averaged(chance, float(root) ** 2) for root in ROOTS])
    return with_slopes(continued_logs(rows, rising=rising), FINE_DB)[:, ::KEPT]


def with_slopes(logs: FloatArray, step_db: float) -> FloatArray:
    """Return rows with their slopes and curvatures, shape (rows, SNRs, 3)."""
    slope = np.gradient(logs, step_db, axis=1)
    return np.stack((logs, slope, np.gradient(slope, step_db, axis=1)), axis=-1)


def continued_logs(rows: FloatArray, *, rising: bool) -> FloatArray:
    """Return the logs of chances that rise or fall with the SNR; where they are too small, along their slope."""
    if not rising:
        rows = rows[:, ::-1]
    logs = np.log(np.maximum(rows, LEAST_CHANCE))
    for row, average in zip(logs, rows, strict=True):
        good = int(np.argmax(average > 2.0 * LEAST_CHANCE))
        if good and good + 1 < row.size:
            row[:good] = row[good] - (row[good + 1] - row[good]) * np.arange(good, 0, -1)
    return logs if rising else logs[:, ::-1]


def _averaged(chance: FloatArray, sigma_db: float) -> FloatArray:
    if sigma_db < FINE_DB:
        return chance
    return averaged_over_loss(chance, FINE_DB, lambda loss_db: normal_below(loss_db, sigma_db))
