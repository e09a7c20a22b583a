"""How likely a flight log is under a radio, as a function of what is fitted.

A packet without a measured power is a Bernoulli trial with the closed probability of delivery. One that arrived with
RSSI r adds the chance of the bin that r lies in, times the probability of delivery at the power that was there, which
the receiver's own error blurs. A lost packet has no RSSI: what a log says of its power is left alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.config import RadioConfig
from channel.fading.shadowing import OneSidedNormalShadowing
from channel.fit.cells import by_distance
from channel.fit.flight_log import FlightLog
from channel.fit.result import Level
from channel.fit.rssi_law import (
    BinChance,
    TruePower,
    bins_of,
    normal_bins,
    one_sided_bins,
    share_below,
    true_power,
    van_der_corput,
)
from channel.fit.success_table import SuccessTable
from channel.geometry import Path
from channel.phy.error_model import Band

NAMES = ("propagation.exponent", "offset_db", "shadowing.sigma_db", "base_loss", "noise.floor_dbm")
ERROR_NAME = "rssi_error_db"
ALL_NAMES = (*NAMES, ERROR_NAME)
EXPONENT, OFFSET, SIGMA, BASE, FLOOR, ERROR = range(6)
MAX_SIGMA_DB = 30.0
LIMITS = {
    "propagation.exponent": (0.0, 20.0),
    "offset_db": (-500.0, 500.0),
    "shadowing.sigma_db": (0.0, MAX_SIGMA_DB),
    "base_loss": (0.0, 0.99),
    "noise.floor_dbm": (-500.0, 100.0),
    ERROR_NAME: (0.02, 3.0),
}
NATURAL_LOW = np.isin(np.arange(len(ALL_NAMES)), (SIGMA, BASE, ERROR))
"""Where the lower limit is nature's, so that an interval may end there."""
NATURAL_HIGH = np.arange(len(ALL_NAMES)) == ERROR
LEAST_SIGMA_DB = 0.01
STEEPEST_START = 12.0
"""A line through readings that were all taken at about one distance may rise, or fall as steeply as no law does."""
TINY = 1e-12
Parameters = FloatArray
"""Exponent, offset in dB, shadowing, base loss, noise floor in dBm, the receiver's own error of RSSI in dB.

The shadowing goes in as sigma in dB where it is one-sided, as sigma^2 where it is normal: so that the likelihood has a
slope at 0.
"""


@dataclass(frozen=True, slots=True)
class Point:
    """The likelihood at one place.

    Attributes:
        at: the parameters.
        value: log-likelihood.
        gradient: of it, one per parameter.
        information: how sharply it is bent, a matrix: the expected information of the Bernoulli trials or, in a log
            with RSSI, the sum of squared scores (Berndt, Hall, Hall, Hausman 1974).
    """

    at: Parameters
    value: float
    gradient: FloatArray
    information: FloatArray


@dataclass(frozen=True, slots=True)
class _Group:
    """Cells of one length: those of packets that arrived with RSSI, and the others."""

    table: SuccessTable
    at_rssi: SuccessTable
    heard: NDArray[np.intp]
    silent: NDArray[np.intp]


class Likelihood:
    """The log-likelihood of one log: computed once for each cell of packets, times how many there are.

    Args:
        log: the flight log.
        base: the radio to fit from.
    """

    def __init__(self, log: FlightLog, base: RadioConfig) -> None:
        self._base = base
        heard = log.delivered & np.isfinite(log.rssi_dbm)
        self.has_rssi = bool(heard.any())
        self._one_sided = isinstance(base.shadowing, OneSidedNormalShadowing)
        low, high = (np.array([LIMITS[name][end] for name in ALL_NAMES]) for end in (0, 1))
        self.low, self.high = self.coordinates(low), self.coordinates(high)
        distance = np.maximum(log.distance_m, base.min_distance_m)
        reference_m = float(getattr(base.propagation, "reference_distance_m", 1.0))
        self._reference_m = reference_m
        self._decades = np.log10(distance / reference_m)
        self._delivered = log.delivered
        self._rssi_dbm = np.full(log.packets, np.nan)
        bin_db = 1.0
        if self.has_rssi:
            self._rssi_dbm[heard], bin_db = bins_of(log.rssi_dbm[heard])
        self._bin_db = bin_db
        cells = by_distance(self._decades, log.length_bytes, log.delivered, self._rssi_dbm)
        self._cell, self._count = cells.of_row, cells.count
        self._cell_decades = cells.mean(self._decades)
        self._cell_arrived, self._cell_rssi_dbm = log.delivered[cells.first], self._rssi_dbm[cells.first]
        self._far = float(np.average(self._decades, weights=np.maximum(1.0 - log.delivered, 1e-3)))
        """Decades of distance at which packets are lost."""
        self._power_at_reference = power_at_reference_dbm(base, reference_m)
        self._floor_dbm = base.noise_floor_dbm
        band = Band(base.bandwidth_hz, base.bit_rate_bps)
        self._groups = []
        lengths, heard = log.length_bytes[cells.first], heard[cells.first]
        for length in np.unique(lengths):
            here = lengths == length
            table = SuccessTable(base.error, float(length), band, one_sided=self._one_sided)
            at_rssi = SuccessTable(base.error, float(length), band, one_sided=False, bin_db=bin_db)
            index = np.flatnonzero(here & heard), np.flatnonzero(here & ~heard)
            self._groups.append(_Group(table, at_rssi, *index))

    @property
    def base_values(self) -> Parameters:
        """The base radio's parameters; a receiver's error of 0.3 dB."""
        exponent = float(getattr(self._base.propagation, "exponent", 2.0))
        sigma_db = self._base.shadowing.spread_db
        base = self._base
        values = [exponent, base.offset_db, sigma_db, base.base_loss, self._floor_dbm, LIMITS[ERROR_NAME][0]]
        return self.coordinates(np.array(values))

    def coordinates(self, natural: FloatArray) -> Parameters:
        """Return parameters from exponent, offset, sigma, base loss, floor and error."""
        out = np.array(natural, dtype=np.float64)
        out[SIGMA] = out[SIGMA] if self._one_sided else out[SIGMA] ** 2
        return out

    def natural(self, at: Parameters) -> FloatArray:
        """Return exponent, offset, sigma, base loss, floor and error from parameters."""
        out = np.array(at)
        out[SIGMA] = out[SIGMA] if self._one_sided else math.sqrt(max(out[SIGMA], 0.0))
        return out

    def sigma_db(self, value: float) -> float:
        """Return sigma from its parameter, infinities kept."""
        return value if self._one_sided or math.isinf(value) else math.sqrt(max(value, 0.0))

    def shifted(self, at: Parameters, step: Parameters) -> Parameters:
        """Return a place a step away, sigma taken on along its own slope: ridges are straight in it, not in sigma^2."""
        out = at + step
        if not self._one_sided:
            sigma_db = math.sqrt(max(float(at[SIGMA]), LEAST_SIGMA_DB**2))
            out[SIGMA] = max(sigma_db + 0.5 * float(step[SIGMA]) / sigma_db, 0.1 * sigma_db) ** 2
        return out

    def at_exponent(self, at: Parameters, exponent: float) -> Parameters:
        """Return about the same radio with another exponent: loses as far away, over as many metres."""
        values = self.natural(at)
        share = exponent / max(values[EXPONENT], 0.1)
        values[OFFSET] += 10.0 * (exponent - values[EXPONENT]) * self._far
        values[SIGMA] *= share
        values[EXPONENT] = exponent
        return self.inside(self.coordinates(values))

    def inside(self, at: Parameters) -> Parameters:
        """Return the nearest place within the limits."""
        return np.clip(at, self.low, self.high)

    def starts(self, exponents: tuple[float, ...], sigmas_db: tuple[float, ...]) -> list[Parameters]:
        """Return points from which to climb."""
        near = self._decades <= np.quantile(self._decades, 0.25)
        base_loss = float(np.clip(1.0 - np.mean(self._delivered[near]), 0.005, 0.5))
        if self.has_rssi:
            return self._starts_from_rssi(base_loss)
        far = self._far
        level = self._floor_dbm + 8.0 - self._power_at_reference
        rest = base_loss, self._floor_dbm, LIMITS[ERROR_NAME][0]
        return [
            self.coordinates(np.array([exponent, level + 10.0 * exponent * far, sigma_db, *rest]))
            for exponent in exponents
            for sigma_db in sigmas_db
        ]

    def _starts_from_rssi(self, base_loss: float) -> list[Parameters]:
        """Return starts from a straight line through the powers measured in the nearer half of what arrived."""
        seen = np.flatnonzero(np.isfinite(self._rssi_dbm))
        out = []
        for share in (0.5, 1.0):
            part = seen[self._decades[seen] <= np.quantile(self._decades[seen], share)]
            design = np.stack((np.ones(part.size), -10.0 * self._decades[part]), axis=-1)
            (_, slope), *_ = np.linalg.lstsq(design, self._rssi_dbm[part], rcond=None)
            slope = min(max(float(slope), 0.0), STEEPEST_START)
            level = float(np.mean(self._rssi_dbm[part] + 10.0 * slope * self._decades[part]))
            spread = float(np.std(self._rssi_dbm[part] - design @ (level, slope)))
            if self._one_sided:  # the half-normal law: mean 0.798 sigma below its edge, deviation 0.603 sigma
                spread /= 0.603
                level += 0.798 * spread
            offset = level - self._power_at_reference
            floor = float(np.quantile(self._rssi_dbm[seen], 0.01)) - 6.0
            values = [float(slope), offset, max(spread, 0.3), base_loss, floor, 1.0]
            out.append(self.inside(self.coordinates(np.array(values))))
        return out

    def point(self, at: Parameters) -> Point:
        """Return the log-likelihood of all packets, with its gradient and its information."""
        value, gradient, information = 0.0, np.zeros(len(ALL_NAMES)), np.zeros((len(ALL_NAMES),) * 2)
        for group in self._groups:
            for index, said in ((group.silent, self._silent), (group.heard, self._heard)):
                if not index.size:
                    continue
                logs, scores, weights = said(at, group)
                count = self._count[index]
                value += float(np.sum(logs * count))
                gradient += np.sum(scores * count, axis=1)
                information += (scores * (weights * count)) @ scores.T
        return Point(at, value, gradient, information)

    def scores(self, at: Parameters) -> FloatArray:
        """Return the slope of each packet's log-likelihood by its power: its mean is 0, whether it arrived or not."""
        out = np.zeros(self._count.size)
        for group in self._groups:
            out[group.silent] = self._silent(at, group)[1][OFFSET]
            out[group.heard] = self._heard(at, group)[1][OFFSET]
        return out[self._cell]

    def covariance(self, best: Point, chosen: NDArray[np.bool_]) -> tuple[tuple[str, ...], FloatArray]:
        """Return the names of the chosen parameters that stand at no limit, and their covariance, sigma in dB."""
        inside = np.flatnonzero(chosen & (best.at > self.low) & (best.at < self.high))
        matrix = best.information[np.ix_(inside, inside)]
        scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), TINY))
        inverse = np.linalg.pinv(matrix * np.outer(scale, scale), hermitian=True) * np.outer(scale, scale)
        slope = np.where(inside == SIGMA, self._sigma_slope(self._sigma_db(best.at)), 1.0)
        named = inside < len(NAMES)
        names = tuple(NAMES[i] for i in inside[named])
        return names, np.asarray((inverse * np.outer(slope, slope))[np.ix_(named, named)])

    def level(
        self,
        best: Point,
        settled: Point,
        names: tuple[str, ...],
        covariance: FloatArray,
        free: NDArray[np.bool_],
    ) -> Level | None:
        """Return the mean power at the log's mean distance: the settled radio's, and an interval about the best one.

        The interval is by the covariance of exponent and offset.
        """
        if not free[[EXPONENT, OFFSET]].any():
            return None
        decades = float(np.mean(self._decades))
        value, middle = (
            self._power_at_reference + float(each.at[OFFSET] - 10.0 * decades * each.at[EXPONENT])
            for each in (settled, best)
        )
        along = np.array(
            [{NAMES[EXPONENT]: -10.0 * decades, NAMES[OFFSET]: 1.0}.get(name, 0.0) for name in names]
        )
        known = all(NAMES[i] in names for i in (EXPONENT, OFFSET) if free[i])
        reach = 1.96 * math.sqrt(max(float(along @ covariance @ along), 0.0)) if known else math.inf
        return Level(self._reference_m * 10.0**decades, value, middle - reach, middle + reach)

    def deliveries(self, at: Parameters) -> FloatArray:
        """Return the probability of delivery of each packet."""
        out = np.zeros(self._count.size)
        for group in self._groups:
            for index in (group.silent, group.heard):
                snr = self._mean_dbm(at, index) - at[FLOOR]
                out[index] = (1.0 - at[BASE]) * group.table.averaged(snr, self._sigma_db(at))[0]
        return out[self._cell]

    def reading_shares(self, at: Parameters) -> FloatArray:
        """Return the law's distribution function at readings where even 3 sigma below the mean all arrives.

        Each is spread over what its bin has of the law by van der Corput's sequence: uniform from 0 to 1 if the law
        holds, also where a bin is wider than the law (Brockwell, Statistics & Probability Letters 77 (2007)).
        """
        sigma_db, error_db = self._sigma_db(at), float(at[ERROR])
        out = []
        for group in self._groups:
            mean = self._mean_dbm(at, group.heard)
            success = group.at_rssi.averaged(mean - 3.0 * math.hypot(sigma_db, error_db) - at[FLOOR], 0.0)[0]
            sure = group.heard[success > 0.999]
            residual = self._cell_rssi_dbm[sure] - self._mean_dbm(at, sure)
            ends = np.full((2, self._count.size), np.nan)
            for end, side in zip(ends, (-0.5, 0.5), strict=True):
                bound_db = residual + side * self._bin_db
                end[sure] = share_below(bound_db, sigma_db, error_db, one_sided=self._one_sided)
            low, high = ends[:, self._cell[np.isfinite(ends[0])[self._cell]]]
            out.append(low + van_der_corput(low.size) * (high - low))
        return np.concatenate(out)

    @property
    def distance_order(self) -> NDArray[np.intp]:
        """Packets from near to far."""
        return np.argsort(self._decades, kind="stable")

    @property
    def delivered(self) -> NDArray[np.bool_]:
        """Whether each packet arrived."""
        return self._delivered

    def _mean_dbm(self, at: Parameters, index: NDArray[np.intp]) -> FloatArray:
        level = self._power_at_reference + at[OFFSET]
        return np.asarray(level - 10.0 * at[EXPONENT] * self._cell_decades[index])

    def _silent(self, at: Parameters, group: _Group) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return log-likelihood, scores (one row per parameter) and weights of cells without RSSI."""
        index = group.silent
        mean = self._mean_dbm(at, index)
        sigma_db = self._sigma_db(at)
        success, by_snr, by_sigma = group.table.averaged(mean - at[FLOOR], sigma_db)
        kept = 1.0 - at[BASE]
        arrives = np.clip(kept * success, TINY, 1.0 - TINY)
        arrived = self._cell_arrived[index]
        chance = np.where(arrived, arrives, 1.0 - arrives)
        slope = np.where(arrived, 1.0, -1.0) / chance
        scores = np.zeros((len(ALL_NAMES), index.size))
        scores[OFFSET] = slope * kept * by_snr
        scores[EXPONENT] = -10.0 * self._cell_decades[index] * scores[OFFSET]
        scores[FLOOR] = -scores[OFFSET]
        scores[SIGMA] = slope * kept * by_sigma * self._sigma_slope(sigma_db)
        scores[BASE] = -slope * success
        weights = np.ones(index.size) if self.has_rssi else chance / (1.0 - chance)
        return np.log(chance), scores, weights

    def _heard(self, at: Parameters, group: _Group) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the same of cells that arrived with RSSI."""
        index = group.heard
        sigma_db, error_db = self._sigma_db(at), float(at[ERROR])
        residual = self._cell_rssi_dbm[index] - self._mean_dbm(at, index)
        law = self._law(sigma_db, error_db, residual)
        power = true_power(residual, sigma_db, error_db, one_sided=self._one_sided)
        snr = self._cell_rssi_dbm[index] - at[FLOOR]
        success, by_snr, by_residual, by_sigma, by_error = _arriving(group.at_rssi, snr, power)
        logs = np.log(success) + np.log(law.chance) + np.log(max(1.0 - at[BASE], TINY))
        scores = np.zeros((len(ALL_NAMES), index.size))
        scores[OFFSET] = -by_residual / success - law.by_residual / law.chance
        scores[EXPONENT] = -10.0 * self._cell_decades[index] * scores[OFFSET]
        scores[SIGMA] = (by_sigma / success + law.by_sigma / law.chance) * self._sigma_slope(sigma_db)
        scores[ERROR] = by_error / success + law.by_error / law.chance
        scores[FLOOR] = -by_snr / success
        scores[BASE] = -1.0 / max(1.0 - at[BASE], TINY)
        return logs, scores, np.ones(index.size)

    def _sigma_db(self, at: Parameters) -> float:
        return max(self.sigma_db(float(at[SIGMA])), LEAST_SIGMA_DB)

    def _sigma_slope(self, sigma_db: float) -> float:
        """Return the derivative of sigma by its parameter."""
        return 1.0 if self._one_sided else 0.5 / sigma_db

    def _law(self, sigma_db: float, error_db: float, residual_db: FloatArray) -> BinChance:
        law = one_sided_bins if self._one_sided else normal_bins
        return law(residual_db, self._bin_db, sigma_db, error_db)

    def overrides(self, at: Parameters) -> dict[str, Any]:
        """Return the keys of a radio with these parameters."""
        exponent, offset, sigma_db, base_loss, floor_dbm = (
            float(value) for value in self.natural(at)[: len(NAMES)]
        )
        out: dict[str, Any] = {
            "propagation": {"exponent": exponent},
            "offset_db": offset,
            "shadowing": {"sigma_db": sigma_db},
            "base_loss": base_loss,
        }
        if floor_dbm != self._floor_dbm:
            out["noise"] = {"model": "fixed", "floor_dbm": floor_dbm}
        return out


def _arriving(
    table: SuccessTable, snr_db: FloatArray, power: TruePower
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the probability of delivery at readings, and its derivatives by SNR, residual, sigma and error."""
    shift, by_residual, by_sigma, by_error = power.shift
    spread, spread_by_sigma, spread_by_error = power.spread
    success, by_snr, by_spread = table.averaged(snr_db + shift, spread)
    if power.share is None:
        slopes = (
            by_snr * by_residual,
            by_snr * by_sigma + by_spread * spread_by_sigma,
            by_snr * by_error + by_spread * spread_by_error,
        )
        return np.maximum(success, TINY), by_snr, *slopes
    share, *share_slopes = power.share  # the average goes linearly with the variance
    sharp, sharp_by_snr, _ = table.averaged(snr_db + shift, 0.0)
    change = success - sharp
    by_snr = sharp_by_snr + share * (by_snr - sharp_by_snr)
    spread_slopes = 0.0, spread_by_sigma, spread_by_error
    edge, steeper, blurred = (
        by_snr * slope + share * by_spread * spread_slope + change * share_slope
        for slope, spread_slope, share_slope in zip(
            (by_residual, by_sigma, by_error), spread_slopes, share_slopes, strict=True
        )
    )
    return np.maximum(sharp + share * change, TINY), by_snr, edge, steeper, blurred


def power_at_reference_dbm(base: RadioConfig, reference_m: float) -> float:
    """Return the received power at the reference distance, level and nose to nose, without the offset."""
    at_reference = Path(base.frequency_hz, np.asarray(reference_m), 1.0, 1.0)
    gains = base.antenna.towards_db(np.array([[1.0, 0.0, 0.0]]))
    receive = base.receiving_antenna.towards_db(np.array([[-1.0, 0.0, 0.0]]))
    cables_db = base.cable_loss_db + base.receiving_cable_loss_db
    fixed = base.transmit_power_dbm + np.sum(gains) + np.sum(receive) - cables_db
    return float(fixed - base.propagation.path_loss_db(at_reference))
