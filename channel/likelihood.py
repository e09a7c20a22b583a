"""How likely a flight log is under a radio, as a function of what is fitted."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from channel.checks import FloatArray
from channel.config import RadioConfig
from channel.error_model import Band
from channel.flight_log import FlightLog
from channel.geometry import Path
from channel.quadrature import standard_normal_rule
from channel.shadowing import OneSidedNormalShadowing

NAMES = ("propagation.exponent", "offset_db", "shadowing.sigma_db", "base_loss", "noise.floor_dbm")
LIMITS = {
    "propagation.exponent": (0.0, 20.0),
    "offset_db": (-500.0, 500.0),
    "shadowing.sigma_db": (0.0, 30.0),
    "base_loss": (0.0, 0.99),
    "noise.floor_dbm": (-500.0, 100.0),
}
EXPONENT, MARGIN, SIGMA, BASE, FLOOR = range(5)
PANELS = 6
AVERAGE_GRID_DB = np.arange(-250.0, 250.0, 0.25)
ROOT_STEP = 0.125
ROOTS = np.arange(0.0, math.sqrt(30.0) + 2.0 * ROOT_STEP, ROOT_STEP)
"""Square roots of sigma for which the average over the shadowing is tabulated, up to its limit."""
SUCCESS_GRID_DB = np.arange(-60.0, 120.0, 0.05)
TINY = 1e-12
RSSI_ERROR_DB = 0.3
"""Standard error of a measured power, dB: about that of a reading in steps of 1 dB."""
Parameters = FloatArray
"""Exponent; offset in dB; square root of sigma; square root of base loss; noise floor in dBm."""


class Likelihood:
    """The log-likelihood of one log, its parameters in coordinates in which their ranges are open or end at 0.

    Sigma and base loss go in as square roots: so that 0 is an inner point of the square, reached smoothly.

    Args:
        log: the flight log.
        base: the radio to fit from.
    """

    def __init__(self, log: FlightLog, base: RadioConfig) -> None:
        self._log = log
        self._base = base
        self.has_rssi = bool(np.any(log.delivered & np.isfinite(log.rssi_dbm)))
        self.with_rssi = log.delivered & np.isfinite(log.rssi_dbm)
        distance = np.maximum(log.distance_m, base.min_distance_m)
        reference_m = getattr(base.propagation, "reference_distance_m", 1.0)
        self._decades = np.log10(distance / reference_m)
        self._pivot = float(np.mean(self._decades))
        at_reference = Path(base.frequency_hz, np.asarray(reference_m), 1.0, 1.0)
        gains = base.antenna.towards_db(np.array([[1.0, 0.0, 0.0]]))
        receive = base.receiving_antenna.towards_db(np.array([[-1.0, 0.0, 0.0]]))
        fixed = base.transmit_power_dbm + np.sum(gains) + np.sum(receive)
        self._power_at_reference = float(fixed - base.propagation.path_loss_db(at_reference))
        self._floor_dbm = base.noise.noise_floor_dbm(base.bandwidth_hz)
        self._one_sided = isinstance(base.shadowing, OneSidedNormalShadowing)
        self.has_edge = self.has_rssi and self._one_sided
        self.rssi_error_db = RSSI_ERROR_DB
        self._lengths = np.unique(log.length_bytes)
        band = Band(base.bandwidth_hz, base.bit_rate_bps)
        self._success = {
            float(length): 1.0 - base.error.per(SUCCESS_GRID_DB, float(length), band)
            for length in self._lengths
        }
        self._averages = {
            length: _average_table(success.tobytes(), one_sided=self._one_sided)
            for length, success in self._success.items()
        }
        self._of_length = {length: np.flatnonzero(log.length_bytes == length) for length in self._success}

    @property
    def base_values(self) -> Parameters:
        """The base radio's parameters."""
        exponent = getattr(self._base.propagation, "exponent", 2.0)
        sigma = getattr(self._base.shadowing, "sigma_db", 0.0)
        roots = math.sqrt(sigma), math.sqrt(self._base.base_loss)
        return np.array([exponent, self._base.offset_db, *roots, self._floor_dbm])

    def start(self, exponent: float, sigma_db: float) -> Parameters:
        """Return a point from which to climb: the SNR of half the packets put where half of them arrived."""
        log = self._log
        weight = 1.0 - log.delivered
        far = float(np.average(self._decades, weights=np.maximum(weight, 1e-3)))
        offset = -self._power_at_reference + self._floor_dbm + 8.0 + 10.0 * exponent * far
        floor = self._floor_dbm
        if self.has_rssi:
            seen = self.with_rssi
            design = np.stack((np.ones(np.count_nonzero(seen)), -10.0 * self._decades[seen]), axis=-1)
            (level, slope), *_ = np.linalg.lstsq(design, log.rssi_dbm[seen], rcond=None)
            residual = log.rssi_dbm[seen] - design @ (level, slope)
            spread = float(np.std(residual))
            if self._one_sided:  # the half-normal law: mean 0.798 sigma below its edge, deviation 0.603 sigma
                spread /= 0.603
                level += 0.798 * spread
            exponent, sigma_db = float(slope), max(spread, 0.1)
            offset = float(level - self._power_at_reference)
            floor = float(np.min(log.rssi_dbm[seen])) - 6.0
        near = self._decades <= np.quantile(self._decades, 0.25)
        base_loss = float(np.clip(1.0 - np.mean(log.delivered[near]), 0.005, 0.5))
        return np.array([exponent, offset, math.sqrt(sigma_db), math.sqrt(base_loss), floor])

    def natural(self, parameters: Parameters) -> FloatArray:
        """Return exponent, offset, sigma, base loss and floor themselves."""
        out = np.array(parameters)
        out[[SIGMA, BASE]] = out[[SIGMA, BASE]] ** 2
        return out

    def inside(self, parameters: Parameters) -> Parameters:
        """Return the nearest point within the limits."""
        low, high = self._bounds()
        return np.clip(parameters, low, high)

    def limit(self, index: int, sign: float) -> float:
        """Return the end of a coordinate's range on one side."""
        return float(self._bounds()[int(sign > 0.0)][index])

    def _bounds(self) -> tuple[FloatArray, FloatArray]:
        low, high = np.array([LIMITS[name] for name in NAMES]).T
        high = high.copy()
        high[[SIGMA, BASE]] = np.sqrt(high[[SIGMA, BASE]])
        return low, high

    def at_limit(self, parameters: Parameters, free: NDArray[np.bool_]) -> bool:
        """Return whether a free coordinate stands at an end of its range that is ours, not nature's."""
        low, high = self._bounds()
        ours = np.array([True, True, False, False, True])
        return bool(np.any(free & ((ours & (parameters <= low)) | (parameters >= high))))

    def scale(self, index: int, at: Parameters) -> float:
        """Return a first step for a search along one coordinate."""
        return (0.05 * max(float(at[EXPONENT]), 1.0), 1.0, 0.1, 0.03, 0.5)[index]

    def slid(self, parameters: Parameters, index: int, target: float) -> Parameters:
        """Return the point with one coordinate moved, the SNR in the middle of the log kept where it was."""
        out = np.array(parameters)
        change = target - out[index]
        out[index] = target
        if index == EXPONENT:
            out[MARGIN] += 10.0 * self._pivot * change
        elif index == MARGIN and self._pivot > 0.1:
            out[EXPONENT] += change / (10.0 * self._pivot)
        return self.inside(out)

    def log_likelihood(self, parameters: Parameters) -> float:
        """Return the sum over all packets."""
        return float(np.sum(self.per_packet(parameters)))

    def per_packet(self, parameters: Parameters) -> FloatArray:
        """Return the log-likelihood of each packet."""
        exponent, offset, sigma_db, base_loss, floor_dbm = self.natural(parameters)
        mean_dbm = self._power_at_reference + offset - 10.0 * exponent * self._decades
        arrives = (1.0 - base_loss) * self._averaged(mean_dbm - floor_dbm, sigma_db)
        out = np.where(
            self._log.delivered, np.log(np.maximum(arrives, TINY)), np.log(np.maximum(1.0 - arrives, TINY))
        )
        if self.has_rssi:
            seen = self.with_rssi
            at_rssi = (1.0 - base_loss) * self._at(
                self._log.rssi_dbm[seen] - floor_dbm, self._log.length_bytes[seen]
            )
            residual = self._log.rssi_dbm[seen] - mean_dbm[seen]
            out[seen] = np.log(np.maximum(at_rssi, TINY)) + self._log_density(residual, max(sigma_db, 1e-3))
        return np.asarray(out)

    def _log_density(self, residual_db: FloatArray, sigma_db: float) -> FloatArray:
        """Return the log of the density of a measured power about its mean without shadowing.

        One-sided: -|N(0, sigma^2)| and a receiver's own error N(0, RSSI_ERROR_DB^2), a skew normal law (Azzalini
        1985); the error rounds off the edge of the half-normal law.
        """
        error_db = self.rssi_error_db if self._one_sided else 0.0
        spread = math.hypot(sigma_db, error_db)
        normal = -0.5 * (residual_db / spread) ** 2 - math.log(spread * math.sqrt(2.0 * math.pi))
        if not self._one_sided:
            return np.asarray(normal)
        skew = -residual_db / spread * (sigma_db / error_db)
        return np.asarray(normal + math.log(2.0) + log_ndtr(skew))

    def _at(self, snr_db: FloatArray, length: FloatArray) -> FloatArray:
        out = np.empty_like(snr_db)
        for each, success in self._success.items():
            here = length == each
            out[here] = np.interp(snr_db[here], SUCCESS_GRID_DB, success)
        return out

    def _averaged(self, snr_db: FloatArray, sigma_db: float) -> FloatArray:
        """Return E[1 - PER] over the shadowing at each packet's mean SNR."""
        at = min(math.sqrt(sigma_db) / ROOT_STEP, len(ROOTS) - 1.0)
        first = min(max(int(at) - 1, 0), len(ROOTS) - 4)
        weights = _cubic_weights(at - first)
        out = np.empty_like(snr_db)
        for length, table in self._averages.items():
            here = self._of_length[length]
            out[here] = np.interp(snr_db[here], AVERAGE_GRID_DB, weights @ table[first : first + 4])
        return np.clip(out, 0.0, 1.0)

    def overrides(self, parameters: Parameters) -> dict[str, Any]:
        """Return the keys of a radio with these parameters."""
        exponent, offset, sigma_db, base_loss, floor_dbm = (
            float(value) for value in self.natural(parameters)
        )
        out: dict[str, Any] = {
            "propagation": {"exponent": exponent},
            "offset_db": offset,
            "shadowing": {"sigma_db": sigma_db},
            "base_loss": base_loss,
        }
        if self.has_rssi:
            out["noise"] = {"model": "fixed", "floor_dbm": floor_dbm}
        return out


def _cubic_weights(at: float) -> FloatArray:
    """Return the weights of Lagrange's cubic through values at 0, 1, 2 and 3, for its value at `at`."""
    a, b, c, d = at, at - 1.0, at - 2.0, at - 3.0
    return np.array([-b * c * d / 6.0, a * c * d / 2.0, -a * b * d / 2.0, a * b * c / 6.0])


@lru_cache(maxsize=64)
def _average_table(success: bytes, *, one_sided: bool) -> FloatArray:
    """Return E[1 - PER], a row per root of sigma, a column per mean SNR.

    Args:
        success: 1 - PER on SUCCESS_GRID_DB, as bytes of float64.
        one_sided: whether the shadowing can only cost.
    """
    curve = np.frombuffer(success)
    z, weights = standard_normal_rule(PANELS)
    kept = weights > 1e-12
    z = np.abs(z[kept]) if one_sided else z[kept]
    rows = []
    for root in ROOTS:
        shifted = AVERAGE_GRID_DB[:, np.newaxis] - root**2 * z
        rows.append(np.interp(shifted, SUCCESS_GRID_DB, curve) @ weights[kept])
    return np.array(rows)
