"""What correlated shadowing leaves unexplained: each reading less what the readings before it on its line foretell."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import kstest

from channel.checks import FloatArray
from channel.fit.correlated.field import Places
from channel.fit.correlated.propagation import Log
from channel.fit.correlated.search import Found
from channel.fit.residuals import chance_of_independence
from channel.fit.rssi_law import van_der_corput

FEWEST = 30
DEVIATIONS = 3.0


class Leftover(NamedTuple):
    """Chances that a log of the fitted radio is as far off; None with too few readings.

    Attributes:
        independence: that the innovations are as correlated in order of time.
        readings: that their law is as far from a normal one.
    """

    independence: float | None
    readings: float | None


def leftover(log: Log, found: Found, places: Places, sure_dbm: float) -> Leftover:
    """Return how well readings fit.

    Only those count that were foretold to be far above the power at which packets are lost: others are there because
    they were strong.

    Args:
        log: by place.
        found: the fit.
        places: of its packets, which are in order of time.
        sure_dbm: power above which nothing is lost.
    """
    line = found.at_mode.line
    mean_dbm = log.fixed_dbm + log.design @ line
    innovation, foretold_dbm, deviation = _innovations(log, found, mean_dbm, np.zeros(mean_dbm.size), places)
    use = (log.readings.count > 0.0) & (foretold_dbm - DEVIATIONS * deviation > sure_dbm)
    if np.count_nonzero(use) < FEWEST:
        return Leftover(None, None)
    first = np.unique(places.of_packet, return_index=True)[1]
    used: NDArray[np.intp] = np.flatnonzero(use)
    order = np.argsort(first[used], kind="stable")
    spread_db = (van_der_corput(mean_dbm.size) - 0.5) * math.sqrt(12.0 * log.readings.step_variance)
    spread = _innovations(log, found, mean_dbm, spread_db, places)[0]
    return Leftover(
        chance_of_independence(innovation[used], order), float(kstest(spread[used], "norm").pvalue)
    )


def _innovations(
    log: Log, found: Found, mean_dbm: FloatArray, spread_db: FloatArray, places: Places
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return innovations in standard deviations, what was foretold, and how surely; a Kalman filter along the line.

    What is added to the readings spreads them over their step.
    """
    law = found.law
    share = np.exp(-np.minimum(places.gap_m / law.decorrelation_m, 40.0)).tolist()
    count = log.readings.count.tolist()
    readings = (log.readings.mean_dbm + spread_db - mean_dbm).tolist()
    more = log.readings.step_variance if np.any(spread_db) else 0.0
    variance, errors = law.sigma_db**2, (log.readings.variance(law.error_db) + more).tolist()
    state, spread = 0.0, variance
    out = np.zeros((3, len(count)))
    for k, (many, reading, error) in enumerate(zip(count, readings, errors, strict=True)):
        if k:
            rho = share[k - 1]
            state, spread = rho * state, rho * rho * spread + (1.0 - rho * rho) * variance
        if many:
            total = spread + error
            out[:, k] = (reading - state) / math.sqrt(total), state, math.sqrt(total)
            gain = spread / total
            state, spread = state + gain * (reading - state), spread * (1.0 - gain)
    return out[0], out[1] + mean_dbm, out[2]
