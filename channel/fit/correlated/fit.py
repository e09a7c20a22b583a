"""Fitting a radio to a log whose packets depend on their neighbours: shadowing that is correlated along the track.

Readings that scatter more than their steps may err, or the packets may fade. Both are fitted: where a reading errs, the
packet's fate goes by the power of its place; where the packet fades, by what was read. The likelier one is taken, and
where neither is much likelier an interval holds those of both.
"""

from __future__ import annotations

import math

import numpy as np

from channel.checks import FloatArray
from channel.config import RadioConfig
from channel.fit.correlated.ends import OPEN, Ends, correlations_of, k_ends, law_ends, line_ends
from channel.fit.correlated.faded import k_db_of, mean_gain_db, most_deviation_db
from channel.fit.correlated.innovations import Leftover, leftover
from channel.fit.correlated.law import Law
from channel.fit.correlated.propagation import CorrelatedLikelihood, Log
from channel.fit.correlated.search import BASE, DECORRELATION, FLOOR, SIGMA, Found, Search
from channel.fit.correlated.taken import TakenLog
from channel.fit.flight_log import FlightLog
from channel.fit.likelihood import LIMITS
from channel.fit.result import GIVEN, Estimate, Level

DECORRELATION_NAME = "shadowing.decorrelation_m"
K_NAME = "fading.k_db"
LINE_NAMES = ("propagation.exponent", "offset_db")
LAW_NAMES = {
    "shadowing.sigma_db": SIGMA,
    DECORRELATION_NAME: DECORRELATION,
    "noise.floor_dbm": FLOOR,
    "base_loss": BASE,
}
SCATTERED_DB = 0.5
"""Standard deviation of readings about the power of their place, from which fading is tried."""
SHORT = 5.0
"""A decorrelation distance below so many gaps between places may be fading, too."""
DOUBT = 5.0
"""Difference of log-likelihoods below which either may be."""
LEAST_SIGMA_DB = 0.3
EXPONENTS = LIMITS[LINE_NAMES[0]]
NO_LAW_NOTE = "the readings rise with distance, or fall as steeply as no law does"
UNDETERMINED_NOTE = "the data do not determine it"
DOUBT_NOTE = "the data do not tell fading from readings that err: the interval holds both"


class CorrelatedFit:
    """What a log says when its shadowing is correlated.

    Args:
        log: the flight log, with readings.
        base: the radio to start from.
        near: exponent, offset, sigma, base loss and floor of a fit without correlation; or known values.
        held: names of what is known.

    Attributes:
        found: the likelier of both fits.
        faded: whether that is the one of packets that fade.
        leftover: how well its readings fit.
    """

    def __init__(self, log: FlightLog, base: RadioConfig, near: FloatArray, held: frozenset[str]) -> None:
        self._log, self._base, self._near, self._held = log, base, near, held
        self._line_free = np.array([name not in held for name in LINE_NAMES])
        self._taken = TakenLog(log, base, near, self._line_free)
        erring = self._taken.erring()
        by_error = self._searched(erring, math.inf)
        by_fading = self._fading(erring, by_error)
        self.faded = by_fading is not None and by_fading.value > by_error.value
        self._either = [each for each in (by_error, by_fading) if each is not None]
        self._either.sort(key=lambda each: each.value, reverse=True)
        self.found = self._either[0]
        self._either = [each for each in self._either if self.found.value - each.value < DOUBT]
        gain_db = mean_gain_db(self._own_scatter_db(self.found)) if self.faded else 0.0
        self.leftover: Leftover = leftover(
            erring, self.found, self._taken.places, self._taken.rssi_dbm, self._taken.sure_dbm(), gain_db
        )

    def _first_law(self) -> Law:
        _, _, sigma_db, base_loss, floor_dbm = self._near.tolist()
        if self._log.delivered.all() and "noise.floor_dbm" not in self._held:
            weakest_dbm = float(np.nanmin(self._taken.rssi_dbm))
            floor_dbm = min(
                self._base.noise_floor_dbm,
                weakest_dbm - 30.0,
            )
        decorrelation_m = self._base.shadowing.decorrelation_m or 20.0
        return Law(max(sigma_db, LEAST_SIGMA_DB), decorrelation_m, 0.3, floor_dbm, base_loss)

    def _searched(self, log: Log, most_scatter_db: float) -> Found:
        free = np.ones(len(Law._fields), dtype=bool)
        for name, index in LAW_NAMES.items():
            free[index] = name not in self._held
        free[FLOOR] &= not self._log.delivered.all()
        likelihood, taken = CorrelatedLikelihood(log), self._taken
        known = self._first_law()
        return Search(
            likelihood, taken.places.extent_m, taken.step_variance, most_scatter_db, known, free
        ).run()

    def _fading(self, erring: Log, by_error: Found) -> Found | None:
        """Return the fit of packets that fade, None where readings do not scatter."""
        short_m = SHORT * self._taken.places.spacing_m
        if self._own_scatter_db(by_error) < SCATTERED_DB and by_error.law.decorrelation_m > short_m:
            return None
        by_fading = self._searched(self._taken.fading(erring), most_deviation_db())
        return by_fading if self._own_scatter_db(by_fading) > SCATTERED_DB else None

    def _own_scatter_db(self, found: Found) -> float:
        """Return the standard deviation of readings about the power of their place, beyond their steps."""
        return math.sqrt(max(found.law.scatter_db**2 - self._taken.step_variance, 0.0))

    @property
    def values(self) -> dict[str, float]:
        """The most likely values by name."""
        found = self.found
        out = {name: float(found.law[index]) for name, index in LAW_NAMES.items()}
        out |= dict(zip(LINE_NAMES, self._line().tolist(), strict=True))
        return out | ({K_NAME: k_db_of(self._own_scatter_db(found))} if self.faded else {})

    def _line(self) -> FloatArray:
        """Return exponent and offset: the most likely within what a law may have."""
        line, free, mode = self._near[:2].copy(), self._line_free, self.found.at_mode
        line[free] = mode.line
        exponent = float(np.clip(line[0], *EXPONENTS))
        if free.all():
            line[1] += mode.covariance[1, 0] / mode.covariance[0, 0] * (exponent - line[0])
        line[0] = exponent
        return line

    def estimates(self) -> tuple[Estimate, ...]:
        """Return exponent, offset, sigma, base loss, floor and decorrelation distance; and K if packets fade."""
        names = (*LINE_NAMES, "shadowing.sigma_db", "base_loss", "noise.floor_dbm", DECORRELATION_NAME)
        return tuple(self._estimate(name) for name in (*names, *([K_NAME] if self.faded else [])))

    def _estimate(self, name: str) -> Estimate:
        if name in self._held:
            return Estimate(name, None, *OPEN, f"as given: {GIVEN}")
        if name in LINE_NAMES and self._is_no_law():
            return Estimate(name, None, *OPEN, NO_LAW_NOTE)
        low, high = self._both_ends(name)
        if name == LINE_NAMES[0] and math.isfinite(high - low):
            low, high = max(low, EXPONENTS[0]), min(high, EXPONENTS[1])
        if math.isinf(low) or math.isinf(high):
            return Estimate(name, None, low, high, UNDETERMINED_NOTE)
        note = DOUBT_NOTE if len(self._either) > 1 else ""
        return Estimate(name, min(max(self.values[name], low), high), low, high, note)

    def _is_no_law(self) -> bool:
        """Return whether the exponent is for certain none that a law may have."""
        low, high = self._both_ends(LINE_NAMES[0]) if self._line_free[0] else OPEN
        return high < EXPONENTS[0] or low > EXPONENTS[1]

    def _both_ends(self, name: str) -> Ends:
        """Return the interval that holds those of the fits that may be."""
        ends = [self._ends(found, name) for found in self._either]
        return min(low for low, _ in ends), max(high for _, high in ends)

    def _ends(self, found: Found, name: str) -> Ends:
        """Return the interval of one fit."""
        if name in LINE_NAMES:
            return self._line_ends(found, np.array([name == each for each in LINE_NAMES], dtype=np.float64))
        if name == K_NAME:
            return k_ends(found, self._taken.step_variance)
        return law_ends(found, LAW_NAMES[name], self._taken.places.extent_m)

    def _line_ends(self, found: Found, along: FloatArray) -> Ends:
        """Return the interval of a sum of exponent and offset; what is held is known."""
        free = self._line_free
        return line_ends(found, along[free], float(along[~free] @ self._near[:2][~free]))

    def level(self) -> Level | None:
        """Return the mean power at the log's mean distance."""
        if not self._line_free.any():
            return None
        taken, values = self._taken, self.values
        decades = float(np.mean(taken.decades))
        along = np.array([-10.0 * decades, 1.0])
        value = float(along @ [values[name] for name in LINE_NAMES])
        ends = [self._line_ends(found, along) for found in self._either]
        low, high = min(low for low, _ in ends), max(high for _, high in ends)
        fixed = taken.level_dbm
        return Level(taken.reference_m * 10.0**decades, value + fixed, low + fixed, high + fixed)

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
        """Return the receiver's own error of a reading, beyond its steps; None where fading stands for it."""
        return None if self.faded else self._own_scatter_db(self.found)
