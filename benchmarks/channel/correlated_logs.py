"""Flight logs with correlated shadowing, drawn with numpy alone: nothing of the channel's code, formulas written anew.

Log-distance loss from free space at 1 m; QPSK over white noise, 24 Mbit/s in 20 MHz, 40 bytes without coding; shadowing
exp(-x / decorrelation) along the line, so that a place that is passed again is shadowed as before; fading as a direct
wave and many from all around, over the way flown (Jakes).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FREQUENCY_HZ = 2.412e9
POWER_AND_GAINS_DBM = 18.0 + 2.0 * 2.3
BITS = 8 * 40
WAVES = 64
NEAREST_M = 20.0
JITTER_M = 0.15
"""Of the places of packets, as gusts and a computer's clock have it: more than a wavelength."""
WATERFALL_DB = 7.0
"""SNR of about 50 % delivery."""


@dataclass(frozen=True, slots=True)
class Truth:
    """A radio to find again, and how it is flown and measured."""

    decorrelation_m: float
    exponent: float
    offset_db: float
    sigma_db: float
    base_loss: float
    floor_dbm: float
    step_db: float = 1.0
    error_db: float = 0.0
    evenly: bool = False
    k_db: float | None = None
    """Of Rician fading; None: no fading."""
    to_m: float | None = None
    """Flown straight out to there; None: twice out and back, to 1.6 times the range of 50 % delivery."""

    @property
    def by_name(self) -> dict[str, float]:
        """What a fit looks for."""
        fading = {} if self.k_db is None else {"fading.k_db": self.k_db}
        return fading | {
            "propagation.exponent": self.exponent,
            "offset_db": self.offset_db,
            "shadowing.sigma_db": self.sigma_db,
            "shadowing.decorrelation_m": self.decorrelation_m,
            "base_loss": self.base_loss,
            "noise.floor_dbm": self.floor_dbm,
        }

    def mean_dbm(self, distance_m: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Return the mean received power."""
        at_1_m = 20.0 * math.log10(4.0 * math.pi * FREQUENCY_HZ / 299_792_458.0)
        level = POWER_AND_GAINS_DBM - at_1_m + self.offset_db
        return np.asarray(level - 10.0 * self.exponent * np.log10(distance_m))


TRUTHS = {
    "10 m, steps of 1 dB": Truth(10.0, 2.6, 1.0, 4.0, 0.08, -92.0),
    "10 m, evenly": Truth(10.0, 3.4, -3.5, 6.0, 0.0, -97.0, step_db=0.5, evenly=True),
    "25 m, steps of 1 dB": Truth(25.0, 2.8, 2.5, 5.5, 0.15, -94.0),
    "25 m, exact": Truth(25.0, 3.8, 4.0, 7.5, 0.02, -99.0, step_db=0.0),
    "50 m, error of 1 dB": Truth(50.0, 2.3, -1.0, 5.0, 0.06, -89.0, error_db=1.0),
    "50 m, steps of 0.5 dB": Truth(50.0, 2.7, 3.0, 6.0, 0.1, -93.0, step_db=0.5),
}
FADED = {
    "Rice, K 12 dB, to 1.2 km": Truth(25.0, 2.6, 0.0, 5.0, 0.05, -94.0, k_db=12.0, to_m=1200.0),
    "Rice, K 6 dB, to 1.2 km": Truth(30.0, 2.8, 0.0, 5.0, 0.05, -95.0, k_db=6.0, to_m=1200.0),
    "Rice, K 9 dB, out and back": Truth(20.0, 3.0, 2.0, 6.0, 0.1, -96.0, step_db=0.5, k_db=9.0),
}
"""The same with fading: seven parameters."""


def drawn(
    truth: Truth, packets: int, seed: Sequence[int]
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
    """Return distances in m, what arrived, and readings in dBm (NaN where lost)."""
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed)))
    level = float(truth.mean_dbm(1.0)) - truth.floor_dbm - WATERFALL_DB
    share = np.abs((np.linspace(0.0, 4.0, packets) + 1.0) % 2.0 - 1.0)
    share = rng.uniform(size=packets) if truth.evenly else share
    distance_m = 10.0 ** (level / (10.0 * truth.exponent)) * (0.1 + 1.5 * share)
    if truth.to_m is not None:
        distance_m = np.linspace(NEAREST_M, truth.to_m, packets) + rng.uniform(-JITTER_M, JITTER_M, packets)
    power_dbm = truth.mean_dbm(distance_m) + truth.sigma_db * _shadowing(
        distance_m, truth.decorrelation_m, rng
    )
    if truth.k_db is not None:
        power_dbm = power_dbm + _fading_db(distance_m, truth.k_db, rng)
    ebn0 = 10.0 ** ((power_dbm - truth.floor_dbm) / 10.0) * (20.0 / 24.0)
    bit_error = 0.5 * np.array([math.erfc(math.sqrt(each)) for each in ebn0])
    arrives = np.exp(BITS * np.log1p(-bit_error)) * (1.0 - truth.base_loss)
    delivered = rng.uniform(size=packets) < arrives
    reading = power_dbm + truth.error_db * rng.standard_normal(packets)
    if truth.step_db > 0.0:
        reading = np.round(reading / truth.step_db) * truth.step_db
    return distance_m, delivered, np.where(delivered, reading, np.nan)


def _fading_db(distance_m: NDArray[np.float64], k_db: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return a Rician power gain over the way flown: a direct wave, and waves from all around (Jakes)."""
    wavelengths = np.cumsum(np.abs(np.diff(distance_m, prepend=distance_m[0]))) * FREQUENCY_HZ / 299_792_458.0
    k, from_rad, phase_rad = 10.0 ** (k_db / 10.0), *rng.uniform(0.0, 2.0 * math.pi, (2, WAVES))
    turns = wavelengths[:, np.newaxis] * np.cos(from_rad)
    scatter = np.sum(np.exp(1j * (2.0 * math.pi * turns + phase_rad)), axis=1) / math.sqrt(WAVES)
    direct = math.sqrt(k) * np.exp(2j * math.pi * wavelengths)
    return np.asarray(20.0 * np.log10(np.abs(direct + scatter) / math.sqrt(1.0 + k)))


def _shadowing(
    distance_m: NDArray[np.float64], decorrelation_m: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return standard normal shadowing at places of a line, from the nearest to the farthest."""
    order = np.argsort(distance_m, kind="stable")
    fresh = rng.standard_normal(distance_m.size)
    correlation = np.exp(-np.diff(distance_m[order], prepend=-np.inf) / decorrelation_m)
    out, last = np.empty(distance_m.size), 0.0
    for place, rho, z in zip(order.tolist(), correlation.tolist(), fresh.tolist(), strict=True):
        last = rho * last + math.sqrt(1.0 - rho * rho) * z
        out[place] = last
    return out
