"""What a reading is, and the law that it follows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
MeanPower = Callable[[Floats, Floats], Floats]
"""Mean reading, dBm, at places of emitters and of sensors, NED, m, shape (..., 3), which broadcast."""


class Reading(NamedTuple):
    """The power of one emitter, measured once, with where and when; (node, emitter, number) names it.

    Attributes:
        number: the sensor's count of its measurements.
        emitter: its place in the sorted ids of all emitters.
        sim_time_ns: when.
        place_ned_m: where, in the fleet's frame, as 32 bit numbers hold it.
        power_dbm: likewise.
    """

    number: int
    emitter: int
    sim_time_ns: int
    place_ned_m: tuple[float, float, float]
    power_dbm: float


def reading(
    number: int, emitter: int, sim_time_ns: int, place_ned_m: tuple[float, float, float], power_dbm: float
) -> Reading:
    """A reading rounded as it is transmitted: who measured it and who hears of it estimate from the same."""
    north, east, down = np.float32(place_ned_m).tolist()
    return Reading(number, emitter, sim_time_ns, (north, east, down), float(np.float32(power_dbm)))


@dataclass(frozen=True, slots=True)
class Spread:
    """How readings spread about their mean, dB, one sigma each.

    Attributes:
        shadowing_db: falls off as exp(-d / decorrelation_m) over the way of one sensor; independent of other sensors'.
        decorrelation_m: None: drawn anew for each reading.
        white_db: fading, receiver noise and steps: independent from reading to reading.
        power_db: of what is believed of the emitter's power: the same for all readings of it.
    """

    shadowing_db: float
    decorrelation_m: float | None
    white_db: float
    power_db: float = 0.0

    @property
    def power_precision(self) -> float:
        """1 / sigma^2 of the power; a power that is known is known to 0.001 dB."""
        return 1.0 / max(self.power_db, 1e-3) ** 2

    def covariance(self, places_ned_m: Floats) -> Floats:
        """Of readings of one sensor, without the common error of the power: dB^2, shape (..., n, n) at (..., n, 3)."""
        away = places_ned_m[..., :, np.newaxis, :] - places_ned_m[..., np.newaxis, :, :]
        here = np.eye(places_ned_m.shape[-2])
        return self.shadowing(np.sqrt(np.sum(away * away, axis=-1))) + self.white_db**2 * here

    def shadowing(self, distance_m: Floats) -> Floats:
        """Covariance of the shadowing of two readings of one sensor at a distance, dB^2."""
        if self.decorrelation_m is None:
            return np.where(distance_m == 0.0, self.shadowing_db**2, 0.0)
        return self.shadowing_db**2 * np.exp(-distance_m / self.decorrelation_m)


def slopes(
    mean_power: MeanPower, emitters_ned_m: Floats, places_ned_m: Floats, step_m: float = 0.5
) -> Floats:
    """Change of the mean reading as the emitter moves north and east, dB/m, shape (..., 2); by central differences."""
    steps = np.zeros((4, 3))
    steps[[0, 1], 0], steps[[2, 3], 1] = (step_m, -step_m), (step_m, -step_m)
    moved = emitters_ned_m[..., np.newaxis, :] + steps
    powers = mean_power(moved, places_ned_m[..., np.newaxis, :])
    return np.stack([powers[..., 0] - powers[..., 1], powers[..., 2] - powers[..., 3]], axis=-1) / (
        2 * step_m
    )
