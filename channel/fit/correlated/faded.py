"""What packets say of the power of their place when each is faded: by Rice's law, whose K is what scatters readings.

A reading is the power that decided the packet's fate. So it says of its place what the law of fading says, and whether
it should have arrived says nothing more of the place, only of the noise floor. A lost packet, or one without a reading,
is a trial with the chance averaged over the fading.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.fit.correlated.law import Law
from channel.fit.correlated.outcomes import (
    FINE_SNR_DB,
    KEPT,
    LEAST_FLOAT,
    ROOTS,
    SNR_DB,
    STEP_DB,
    Outcomes,
    Said,
    continued_logs,
    looked_up,
    with_slopes,
)
from channel.fit.rssi_law import OUTLIERS
from channel.numbers import special
from channel.phy.error_model import Band, ErrorModel

K_DB = np.arange(-10.0, 25.25, 0.25)
"""Below, a fading is Rayleigh's as far as a log can show; above, the steps of readings hide it."""
PADDED = 2048
CENTRE = int(np.argmin(np.abs(SNR_DB)))
_PER_DB = math.log(10.0) / 10.0
_BLURS = np.exp(-2.0 * (math.pi * np.fft.rfftfreq(PADDED, STEP_DB) * ROOTS[:, np.newaxis] ** 2) ** 2)


def gain_density(gain_db: FloatArray, k_db: float) -> FloatArray:
    """Return the density, per dB, of a Rician power gain of mean 1 (Rappaport, sec. 5.6.2)."""
    k, gain = 10.0 ** (k_db / 10.0), np.exp(_PER_DB * gain_db)
    direct = 2.0 * np.sqrt(k * (1.0 + k) * gain)
    near = np.exp(-((np.sqrt((1.0 + k) * gain) - math.sqrt(k)) ** 2)) * special.i0e(direct)
    return np.asarray(_PER_DB * (1.0 + k) * gain * near)


@lru_cache(maxsize=1)
def _moments() -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation of the gain in dB at each of `K_DB`."""
    density = np.stack([gain_density(SNR_DB, k_db) for k_db in K_DB.tolist()]) * STEP_DB
    mean = density @ SNR_DB
    return mean, np.sqrt(density @ SNR_DB**2 - mean**2)


def k_db_of(deviation_db: float) -> float:
    """Return the K whose gain has a standard deviation in dB, the nearest there is."""
    return float(np.interp(deviation_db, _moments()[1][::-1], K_DB[::-1]))


def most_deviation_db() -> float:
    """Return the standard deviation in dB of the deepest fading there is."""
    return float(_moments()[1][0])


def mean_gain_db(deviation_db: float) -> float:
    """Return the mean gain in dB of the law that has a standard deviation in dB; negative."""
    return float(np.interp(k_db_of(deviation_db), K_DB, _moments()[0]))


class FadedOutcomes(Outcomes):
    """Chances of readings, arrivals and losses averaged over fading and normal laws of the place's SNR.

    Args:
        error: the error model.
        band: noise bandwidth and bit rate.
        lengths: those that occur, as the error model counts them.
        length: which of them each packet has, shape (packets,).
        delivered: whether each packet arrived.
        rssi_dbm: its reading, NaN where there is none.
        step_variance: of what rounding does to readings, dB squared.
    """

    def __init__(
        self,
        error: ErrorModel,
        band: Band,
        lengths: list[float],
        length: NDArray[np.intp],
        delivered: NDArray[np.bool_],
        rssi_dbm: FloatArray,
        step_variance: float,
    ) -> None:
        super().__init__(error, band, [], length, delivered)
        self._success = [1.0 - error.per(FINE_SNR_DB, each, band) for each in lengths]
        self._heard = np.flatnonzero(np.isfinite(rssi_dbm))
        self._silent = bool((delivered & ~np.isfinite(rssi_dbm)).any())
        self._rssi_dbm = np.where(np.isfinite(rssi_dbm), rssi_dbm, 0.0)
        self._is_heard = np.isfinite(rssi_dbm)
        self._length = length
        self._step_variance = step_variance
        self._first[self._heard] = 2 * len(lengths) * ROOTS.size * SNR_DB.size
        self._tables: tuple[float, FloatArray] = (math.nan, np.empty((0, 3)))

    def first(self, law: Law, /) -> tuple[FloatArray, FloatArray]:
        """Return weight and mean SNR of the normal factors to begin with: those of readings, by moments."""
        mean_db = mean_gain_db(self.deviation_db(law))
        return self._is_heard / law.scatter_db**2, self._rssi_dbm - mean_db - law.floor_dbm

    def said(self, snr_db: FloatArray, variance: FloatArray, law: Law) -> Said:
        """Return what each packet says, for normal laws of the SNR of its place."""
        k_db = k_db_of(self.deviation_db(law))
        if k_db != self._tables[0]:
            self._tables = k_db, self._rows_of(k_db)
        reading_db = self._rssi_dbm - law.floor_dbm
        at_db = np.where(self._is_heard, snr_db - reading_db, snr_db)
        blurred = np.where(self._is_heard, variance + self._step_variance, variance)
        said = self._with_base_loss(looked_up(self._tables[1], self._first, at_db, blurred), law.base_loss)
        said.log[self._heard] += self._arriving(reading_db[self._heard]) + 0.5 * math.log(2.0 * math.pi)
        return said

    def deviation_db(self, law: Law) -> float:
        """Return the standard deviation of the fading: of what scatters readings, less their steps."""
        return math.sqrt(max(law.scatter_db**2 - self._step_variance, 0.0))

    def _arriving(self, reading_db: FloatArray) -> FloatArray:
        """Return the log of the chance of arrival at SNRs as read, within their steps."""
        out, step_db = np.zeros(reading_db.size), math.sqrt(self._step_variance)
        length = self._length[self._heard]
        for each, success in enumerate(self._success):
            here = length == each
            both = (np.interp(reading_db[here] + side, FINE_SNR_DB, success) for side in (-step_db, step_db))
            out[here] = np.log(np.maximum(0.5 * sum(both), LEAST_FLOAT))
        return out

    def _rows_of(self, k_db: float) -> FloatArray:
        """Return tables: of arrival and loss at each length, then of readings less the SNR of their place."""
        density = gain_density(-SNR_DB, k_db)
        density /= np.sum(density) * STEP_DB
        law = np.fft.rfft(density, PADDED) * _BLURS
        tables = []
        for success in self._success:
            steps = np.fft.rfft(np.diff(success[::KEPT], prepend=0.0), PADDED) * STEP_DB
            averaged = np.roll(np.fft.irfft(law * steps, PADDED), -CENTRE, axis=1)[:, : SNR_DB.size]
            rows = np.clip(np.cumsum(averaged, axis=1), 0.0, 1.0)
            arrives = continued_logs(rows, rising=True) if self._silent else np.zeros_like(rows)
            tables += [with_slopes(arrives, STEP_DB)]
            tables += [with_slopes(continued_logs(1.0 - rows, rising=False), STEP_DB)]
        readings = np.maximum(np.fft.irfft(law, PADDED)[:, : SNR_DB.size], 0.0)
        tables += [with_slopes(np.log(readings + OUTLIERS), STEP_DB)]
        return np.stack(tables).reshape(-1, 3)
