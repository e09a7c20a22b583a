"""How well independent shadowing fits a log."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2, kstest

from channel.fit.likelihood import Likelihood, Point

GROUPS = 20
FITTED = 3
"""Degrees of freedom that the fitted curve takes from the groups."""
FEWEST = 30
LEAST_EXPECTED = 5.0


def readings_and_deliveries(likelihood: Likelihood, best: Point) -> tuple[float | None, float | None]:
    """Return the chances that a log of the fitted radio is as far off in its readings, and in its deliveries.

    Readings: Kolmogorov and Smirnov's test of those that are too strong to be lost. Deliveries: chi-squared over twenty
    groups of packets by distance, those with fewer than five expected arrivals or losses put together with the next.
    """
    readings = None
    if likelihood.has_rssi:
        shares = likelihood.reading_shares(best.at)
        readings = float(kstest(shares, "uniform").pvalue) if shares.size >= FEWEST else None
    return readings, _deliveries(likelihood, best)


def _deliveries(likelihood: Likelihood, best: Point) -> float | None:
    chance, arrived = likelihood.deliveries(best.at), likelihood.delivered
    total, groups = np.zeros(4), []
    for part in np.array_split(likelihood.distance_order, GROUPS):
        expected = float(np.sum(chance[part]))
        spread = float(np.sum(chance[part] * (1.0 - chance[part])))
        total += (float(np.sum(arrived[part])) - expected, spread, expected, part.size - expected)
        if min(total[2], total[3]) >= LEAST_EXPECTED:
            groups.append(total[0] ** 2 / total[1])
            total = np.zeros(4)
    if len(groups) <= FITTED:
        return None
    return float(chi2.sf(sum(groups), len(groups) - FITTED))
