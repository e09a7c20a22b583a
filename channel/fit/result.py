"""What a fit says: estimates with their intervals, how they hang together, and how well the model fits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

GIVEN = "the base radio's"
"""How the note of a parameter ends that was not fitted."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """One parameter.

    Attributes:
        name: as in the radio's configuration.
        value: the most likely one, or None if the data do not determine it.
        low: lower end of the 95 % interval; -inf if the data set none.
        high: upper end; inf if the data set none.
        note: what the data say of it, if not all.
    """

    name: str
    value: float | None
    low: float
    high: float
    note: str = ""


@dataclass(frozen=True, slots=True)
class Level:
    """Mean received power at a distance amid the log: what the log knows best, while `offset_db` counts from 1 m.

    Attributes:
        distance_m: geometric mean of the log's distances.
        value_dbm: mean power of the fitted radio there.
        low_dbm: lower end of its 95 % interval; -inf if the data set none.
        high_dbm: upper end; inf if the data set none.
    """

    distance_m: float
    value_dbm: float
    low_dbm: float
    high_dbm: float


@dataclass(frozen=True, slots=True)
class Goodness:
    """How well the fitted model fits; each a chance that a log of the fitted radio is as far off, 0 to 1.

    Attributes:
        independence: that what is left of the packets is as correlated from each to the next; where the shadowing is
            fitted as correlated, what is left after that; None with too few strong readings, and where packets depend
            on each other and are taken as independent for want of a law.
        readings: that the scatter of the readings is as far from the law; None with too few, where packets fade, and
            where packets depend on each other without a law.
        deliveries: that the deliveries by distance are as far from the curve; None where packets depend on each other,
            which leaves it open, or there are too few losses.
        independent_at_first: `independence` of a fit without correlation, which decides whether there is one.
    """

    independence: float | None
    readings: float | None
    deliveries: float | None
    independent_at_first: float


@dataclass(frozen=True, slots=True)
class Fit:
    """A fitted radio.

    Attributes:
        estimates: one per parameter.
        log_likelihood: at the maximum.
        packets: in the log.
        delivered: of these.
        overrides: what to lay over the base radio: the fitted values, the base's where nothing was determined.
        rssi_error_db: the receiver's own error of RSSI, a by-product; None without RSSI, and where packets fade.
        level: mean power at the log's mean distance; None where neither offset nor exponent was fitted.
        correlations: of the estimates, by name and name; of those that were fitted and determined.
        correlated: whether the shadowing was fitted as correlated along the track.
        goodness: of the fit.
    """

    estimates: tuple[Estimate, ...]
    log_likelihood: float
    packets: int
    delivered: int
    overrides: Mapping[str, Any]
    rssi_error_db: float | None = None
    level: Level | None = None
    correlations: Mapping[str, Mapping[str, float]] | None = None
    correlated: bool = False
    goodness: Goodness | None = None
