"""What correlated shadowing leaves unexplained.

Between places: each reading less what the readings before it on its line foretell. Within a place: each reading less
the mean there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import kstest

from channel.checks import FloatArray
from channel.fit.correlated.field import PlacesOnLinks
from channel.fit.correlated.propagation import Log
from channel.fit.correlated.search import Found
from channel.fit.residuals import chance_of_independence
from channel.fit.rssi_law import van_der_corput

FEWEST = 30
DEVIATIONS = 3.0
NEARLY_NONE = 0.02


class Leftover(NamedTuple):
    """Chances that a log of the fitted radio is as far off; None with too few readings.

    Attributes:
        independence: that what is left of readings is as correlated in order of time, between places or within them.
        readings: that their law is as far from a normal one.
    """

    independence: float | None
    readings: float | None


def leftover(
    log: Log, found: Found, places: PlacesOnLinks, rssi_dbm: FloatArray, sure_dbm: float, gain_db: float
) -> Leftover:
    """Return how well readings fit.

    Between places only those count that were foretold to be far above the power at which packets are lost: others are
    there because they were strong. If there are few, those of the near part of the log count, where hardly any is lost.

    Args:
        log: by place.
        found: the fit.
        places: of its packets, which are in order of time.
        rssi_dbm: reading of each packet, NaN where there is none.
        sure_dbm: power above which nothing is lost.
        gain_db: mean of what scatters readings.
    """
    mean_dbm = log.fixed_dbm + log.design @ found.at_mode.line + gain_db
    none = np.zeros(mean_dbm.size)
    innovation, foretold_dbm, deviation = _innovations(log, found, mean_dbm, none, places)
    read = log.readings.count > 0.0
    use = read & (foretold_dbm - DEVIATIONS * deviation > sure_dbm)
    if np.count_nonzero(use) < FEWEST:
        use = read & _near(mean_dbm, places, rssi_dbm, found.law.base_loss)
    heard = np.isfinite(rssi_dbm)
    within = rssi_dbm[heard] - log.readings.mean_dbm[places.of_packet[heard]]
    least = chance_of_independence(within, np.arange(within.size)) if within.any() else 1.0
    if np.count_nonzero(use) < FEWEST:
        return Leftover(min(1.0, 2.0 * least) if within.any() else None, None)
    first = np.unique(places.of_packet, return_index=True)[1]
    used: NDArray[np.intp] = np.flatnonzero(use)
    order = np.argsort(first[used], kind="stable")
    spread_db = (van_der_corput(mean_dbm.size) - 0.5) * math.sqrt(12.0 * log.readings.step_variance)
    spread = _innovations(log, found, mean_dbm, spread_db, places)[0]
    least = min(least, chance_of_independence(innovation[used], order))
    return Leftover(min(1.0, 2.0 * least), float(kstest(spread[used], "norm").pvalue))


def _near(
    mean_dbm: FloatArray, places: PlacesOnLinks, rssi_dbm: FloatArray, base_loss: float
) -> NDArray[np.bool_]:
    """Return the places up to the distance within which no more than base loss and one packet in fifty are missing."""
    order = np.argsort(-mean_dbm[places.of_packet], kind="stable")
    missing = np.cumsum(~np.isfinite(rssi_dbm[order]))
    count = np.arange(1, order.size + 1)
    good = np.flatnonzero(missing <= (base_loss + NEARLY_NONE) * count)
    last = order[good[-1]] if good.size else order[0]
    return np.asarray(mean_dbm >= mean_dbm[places.of_packet[last]])


def _innovations(
    log: Log, found: Found, mean_dbm: FloatArray, spread_db: FloatArray, places: PlacesOnLinks
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return innovations in standard deviations, what was foretold, and how surely; a Kalman filter along the line.

    What is added to the readings spreads them over their step.
    """
    law = found.law
    share = np.exp(-np.minimum(places.gap_m / law.decorrelation_m, 40.0)).tolist()
    count = log.readings.count.tolist()
    readings = (log.readings.mean_dbm + spread_db - mean_dbm).tolist()
    more = log.readings.step_variance if np.any(spread_db) else 0.0
    variance, errors = law.sigma_db**2, (log.readings.variance(law.scatter_db) + more).tolist()
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
