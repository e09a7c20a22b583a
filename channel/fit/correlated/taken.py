"""A log as the integral over its shadowing takes it: with readings that err, or with packets that fade."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.config import RadioConfig
from channel.fit.cells import alike
from channel.fit.correlated.faded import FadedOutcomes
from channel.fit.correlated.field import places_of
from channel.fit.correlated.outcomes import FINE_SNR_DB, Outcomes
from channel.fit.correlated.propagation import Log, Readings
from channel.fit.correlated.search import LEAST_SCATTER_DB
from channel.fit.flight_log import FlightLog
from channel.fit.likelihood import power_at_reference_dbm
from channel.fit.rssi_law import step_of
from channel.phy.error_model import Band

CERTAIN = 1e-9
"""Chance of a loss below which an arrival says nothing of the floor, with a margin of power on top."""
MARGIN_DB = 12.0
WILD = 7.0
"""A reading that is so many sigma from the mean is an arrival without one."""


class TakenLog:
    """A log by place.

    Args:
        log: the flight log.
        base: the radio to start from.
        near: exponent, offset, sigma, base loss and floor of a fit without correlation; or known values.
        line_free: whether exponent and offset are fitted.

    Attributes:
        places: of its packets.
        decades: of each packet's distance, from the reference.
        level_dbm: the base radio's power at the reference.
        rssi_dbm: reading of each packet, NaN where there is none or a wild one.
        heard: where there is one.
        step_variance: of what rounding does to readings, dB squared.
    """

    def __init__(
        self, log: FlightLog, base: RadioConfig, near: FloatArray, line_free: NDArray[np.bool_]
    ) -> None:
        self._log, self._base, self._near, self._line_free = log, base, near, line_free
        self.reference_m = float(getattr(base.propagation, "reference_distance_m", 1.0))
        distance_m = np.maximum(log.distance_m, base.min_distance_m)
        self.decades = np.log10(distance_m / self.reference_m)
        self.level_dbm = power_at_reference_dbm(base, self.reference_m)
        self.rssi_dbm = self._without_wild_readings()
        self.heard = np.isfinite(self.rssi_dbm)
        self.step_variance = LEAST_SCATTER_DB**2 + step_of(self.rssi_dbm[self.heard]) ** 2 / 12.0
        self.places = places_of(distance_m, log.link)
        self._band = Band(base.bandwidth_hz, base.bit_rate_bps)

    def _without_wild_readings(self) -> FloatArray:
        exponent, offset, sigma_db = self._near[:3]
        mean = self.level_dbm + offset - 10.0 * exponent * self.decades
        wild = np.abs(self._log.rssi_dbm - mean) > WILD * max(sigma_db, 1.0)
        return np.where(self._log.delivered & ~wild, self._log.rssi_dbm, np.nan)

    def sure_dbm(self) -> float:
        """Return the power above which nothing is lost but by base loss, if the floor is where it seemed."""
        base, longest = self._base, float(np.max(self._log.length_bytes))
        lost = base.error.per(FINE_SNR_DB, longest, self._band)
        above = FINE_SNR_DB[np.flatnonzero(lost > CERTAIN)]
        return float(self._near[4]) + (float(above[-1]) if above.size else -math.inf)

    def erring(self) -> Log:
        """Return the log with readings about the power of their place, which alone decides the packets' fates."""
        places, count = self.places, self.places.gap_m.size + 1
        decades = np.zeros(count)
        decades[places.of_packet] = self.decades
        columns = np.stack((-10.0 * decades, np.ones(count)), axis=-1)
        held = ~self._line_free
        known = self._near[:2]
        doubtful = ~self.heard | (self.rssi_dbm < self.sure_dbm() + MARGIN_DB)
        one, packets = self._alike(np.flatnonzero(doubtful))
        lengths, length = np.unique(self._log.length_bytes[one], return_inverse=True)
        delivered = self._log.delivered[one]
        return Log(
            places=places,
            fixed_dbm=self.level_dbm + columns[:, held] @ known[held],
            design=columns[:, self._line_free],
            readings=self._readings(count),
            place=places.of_packet[one],
            packets=packets,
            outcomes=Outcomes(self._base.error, self._band, lengths.tolist(), length.reshape(-1), delivered),
            certain=int(np.count_nonzero(~doubtful)),
        )

    def fading(self, erring: Log) -> Log:
        """Return the log with readings of the faded power, which decides the packets' fates."""
        log, none = self._log, np.zeros(erring.fixed_dbm.size)
        one, packets = self._alike(np.arange(log.packets), self.rssi_dbm)
        lengths, length = np.unique(log.length_bytes[one], return_inverse=True)
        outcomes = FadedOutcomes(
            self._base.error,
            self._band,
            lengths.tolist(),
            length.reshape(-1),
            log.delivered[one],
            self.rssi_dbm[one],
            self.step_variance,
        )
        return replace(
            erring,
            readings=Readings(none, none, 0.0, self.step_variance),
            place=self.places.of_packet[one],
            packets=packets,
            outcomes=outcomes,
            certain=0,
        )

    def _alike(self, chosen: NDArray[np.intp], *said: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        """Return a packet of each cell of those chosen that say the same of one place, and how many are in each."""
        log = self._log
        columns = self.places.of_packet, log.length_bytes, log.delivered, *said
        cells = alike(*(column[chosen] for column in columns))
        return chosen[cells.first], cells.count

    def _readings(self, places: int) -> Readings:
        where, rssi = self.places.of_packet[self.heard], self.rssi_dbm[self.heard]
        count = np.bincount(where, minlength=places).astype(np.float64)
        mean = np.bincount(where, rssi, places) / np.maximum(count, 1.0)
        return Readings(count, mean, float(np.sum((rssi - mean[where]) ** 2)), self.step_variance)
