"""E[1 - PER]: the probability of delivery averaged over shadowing and fading."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.config import RadioConfig
from channel.fading.quadrature import (
    POINTS_PER_PANEL,
    split_gauss_legendre,
    split_normal_rule,
    standard_normal_rule,
)
from channel.link.tables.curves import Curves
from channel.link.tables.lengths import Lengths
from channel.phy.error_model import Band

PANELS = 32
CHUNK_VALUES = 1 << 19
"""Integrands are evaluated in chunks of about this many values: bounds memory, changes no result."""
CURVE_STEPS_PER_DB = 50
CURVE_STEP_DB = 1.0 / CURVE_STEPS_PER_DB
CURVE_RANGE_DB = (-150.0, 400.0)
LEAST_STEPS_PER_DB = 1000
"""To which an SNR is rounded below which nothing comes."""
LEVELS_PER_DB = 4.0
"""Curves for such SNRs, where each link has one of its own."""
LEVEL_ALONE = np.inf
"""Of a curve over the SNR less that: errors play no part."""
NEARLY_NONE = 1e-4
FINER = 8
"""So many more panels has a fading of one's own that no SNR can split, where the error rate jumps at one."""
LEVEL = np.zeros(1)
DEGREES = 91
"""Elevations from 0 to 90 degrees."""


SplitRule = Callable[[FloatArray, int, FloatArray], tuple[FloatArray, FloatArray]]
ChanceBelow = Callable[[FloatArray, FloatArray], FloatArray]


class Expectation:
    """E[1 - PER] of a radio as a function of its mean SNR.

    Args:
        config: the radio.
        band: its noise bandwidth and bit rate.
    """

    def __init__(self, config: RadioConfig, band: Band) -> None:
        self._config = config
        self._band = band
        self._split_fading: SplitRule | None = getattr(config.fading, "split_rule", None)
        self._curves = Curves(CURVE_STEPS_PER_DB, self._make_curve)

    def averaged(
        self,
        snr_db: FloatArray,
        length_bytes: FloatArray,
        elevation_deg: FloatArray,
        panels: int = PANELS,
        least_db: FloatArray | float | None = None,
    ) -> FloatArray:
        """Return E[1 - PER] by quadrature, in the broadcast shape of the arguments.

        Args:
            snr_db: mean SNR: without the random terms.
            length_bytes: as the error model counts it.
            elevation_deg: for fading that depends on it.
            panels: of the quadrature rule for each random term.
            least_db: an SNR, with the random terms, below which nothing comes; None: there is none.
        """
        if self._config.shadowing.is_random and self._config.fading.is_random:
            panels //= 2  # the nodes of the two multiply
        elif self._steps_alone(least_db) and self._split_fading is None:
            panels *= FINER
        snr, length, elevation = np.broadcast_arrays(snr_db, length_bytes, elevation_deg)
        out = np.empty(snr.size)
        least = None if least_db is None else np.broadcast_to(least_db, snr.shape).ravel()
        rows = max(1, CHUNK_VALUES // self._nodes(panels))
        for start in range(0, out.size, rows):
            part = slice(start, start + rows)
            columns = snr.ravel()[part], length.ravel()[part], elevation.ravel()[part]
            out[part] = self._chunk(*columns, panels, None if least is None else least[part])
        return np.clip(out, 0.0, 1.0).reshape(snr.shape)

    def _steps_alone(self, least_db: FloatArray | float | None) -> bool:
        """Whether the chance of arrival jumps or bends at SNRs, and fading alone is random about them."""
        is_alone = self._config.fading.is_random and not self._config.shadowing.is_random
        return is_alone and (least_db is not None or bool(self._config.error.breaks_db))

    def _nodes(self, panels: int) -> int:
        """About how many there are for each link."""
        gain_db, _ = self._config.fading.rule(LEVEL, panels)
        of_shadowing = POINTS_PER_PANEL * (panels + 2 * len(self._config.error.breaks_db) + 2)
        return int(gain_db.shape[-1]) * (of_shadowing if self._config.shadowing.is_random else 1)

    def _chunk(
        self,
        snr_db: FloatArray,
        length: FloatArray,
        elevation_deg: FloatArray,
        panels: int,
        least_db: FloatArray | None,
    ) -> FloatArray:
        gain_db, gain_weights = self._fading_rule(snr_db, elevation_deg, panels, least_db)
        level_db = snr_db[:, np.newaxis] + gain_db
        loss_db, loss_weights = self._shadowing_rule(level_db, panels, least_db)
        at = level_db[:, np.newaxis] - loss_db
        success = 1.0 - self._config.error.per(at, length[:, np.newaxis, np.newaxis], self._band)
        if least_db is not None:
            success = np.where(at >= least_db[:, np.newaxis, np.newaxis], success, 0.0)
        over_shadowing = np.sum(success * loss_weights, axis=1)
        return np.asarray(np.sum(over_shadowing * gain_weights, axis=-1))

    def _fading_rule(
        self, snr_db: FloatArray, elevation_deg: FloatArray, panels: int, least_db: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return gains and weights, shape (links or 1, nodes) or (nodes,), split where the error rate jumps."""
        if not self._steps_alone(least_db) or self._split_fading is None:
            return self._config.fading.rule(elevation_deg, panels)
        breaks_db = self._breaks_db(snr_db.size, least_db)
        return self._split_fading(elevation_deg, panels, breaks_db - snr_db[:, np.newaxis])

    def _breaks_db(self, links: int, least_db: FloatArray | None) -> FloatArray:
        """Return SNRs at which the chance of arrival jumps or bends, shape (links, breaks)."""
        breaks_db = self._config.error.breaks_db
        rows = np.broadcast_to(breaks_db, (links, len(breaks_db)))
        return rows if least_db is None else np.column_stack((rows, least_db))

    def _shadowing_rule(
        self, level_db: FloatArray, panels: int, least_db: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return losses and weights, shape (links or 1, nodes, gains or 1), split where the error rate jumps.

        Args:
            level_db: SNRs with the fading's gains, shape (links, gains).
            panels: before the splits.
            least_db: see `averaged`, shape (links,).
        """
        shadowing = self._config.shadowing
        if not shadowing.is_random:
            return np.zeros((1, 1, 1)), np.ones((1, 1, 1))
        breaks_db = self._breaks_db(len(level_db), least_db)
        if not breaks_db.size:
            nodes, weights = standard_normal_rule(panels)
            return shadowing.loss_db(nodes)[:, np.newaxis], weights[:, np.newaxis]
        margin = (level_db[..., np.newaxis] - breaks_db[:, np.newaxis]) / shadowing.spread_db
        margin = margin.reshape(level_db.size, -1)
        rule = split_normal_rule(np.concatenate((margin, -margin), axis=1), panels)
        nodes, weights = (each.reshape(*level_db.shape, -1).swapaxes(1, 2) for each in rule)
        return shadowing.loss_db(nodes), weights

    def from_table(
        self,
        snr_db: FloatArray,
        lengths: Lengths,
        elevation_deg: FloatArray | None,
        least_db: FloatArray | float | None = None,
    ) -> FloatArray:
        """Return E[1 - PER] from curves in steps of 0.02 dB: fast, within 1e-5 of the quadrature.

        With fading that depends on elevation, angles are rounded to whole degrees. Where the error rate jumps and
        little is random (less than 1 dB) it is within 3e-4; with an SNR below which nothing comes (``least_db``), and
        shadowing and fading, within 0.01.
        """
        if isinstance(least_db, np.ndarray) and least_db.ndim:
            return self._from_tables(snr_db, lengths, elevation_deg, least_db)
        least = None if least_db is None else float(least_db)
        if least is not None and least != LEVEL_ALONE:
            least = round(least * LEAST_STEPS_PER_DB) / LEAST_STEPS_PER_DB
        if elevation_deg is None:
            which = self._curves.rows([(length, 0, least) for length in lengths.distinct], lengths.which)
            return self._curves.between(snr_db, which)
        degrees = np.rint(elevation_deg).astype(np.intp)
        kind = degrees + DEGREES * np.asarray(lengths.which)
        kinds = np.flatnonzero(np.bincount(kind.ravel()))
        place = np.zeros(int(kinds[-1]) + 1 if kinds.size else 1, dtype=np.intp)
        place[kinds] = np.arange(kinds.size)
        keys = [(lengths.distinct[each // DEGREES], each % DEGREES, least) for each in kinds.tolist()]
        return self._curves.between(snr_db, self._curves.rows(keys, place[kind]))

    def _from_tables(
        self, snr_db: FloatArray, lengths: Lengths, elevation_deg: FloatArray | None, least_db: FloatArray
    ) -> FloatArray:
        """As `from_table`, of links with an SNR each below which nothing comes (`least_db`), from a few curves.

        Where packets come through at that SNR for certain, the level alone decides; where none does, the error rate
        alone. Between the two values are interpolated between levels 0.25 dB apart, each at the link's distance to it.
        """
        snr_db, least_db = np.broadcast_arrays(snr_db, least_db)
        out = np.empty(snr_db.shape)
        chance = 1.0 - self._config.error.per(least_db, self._bytes_of(lengths, out.shape), self._band)

        def tabulated(here: NDArray[np.intp], at_db: FloatArray, least: float | None) -> FloatArray:
            angles = None if elevation_deg is None else np.broadcast_to(elevation_deg, out.shape)[here]
            return self.from_table(at_db, lengths.at(here), angles, least)

        never = np.flatnonzero(chance < NEARLY_NONE)
        out[never] = tabulated(never, snr_db[never], None)
        always = np.flatnonzero(chance > 1.0 - NEARLY_NONE)
        out[always] = tabulated(always, snr_db[always] - least_db[always], LEVEL_ALONE)
        some = np.flatnonzero((chance >= NEARLY_NONE) & (chance <= 1.0 - NEARLY_NONE))
        place = least_db[some] * LEVELS_PER_DB
        lower = np.floor(place)
        out[some] = 0.0
        for step in np.unique(np.concatenate((lower, lower + 1.0))).tolist():
            weight = np.maximum(0.0, 1.0 - np.abs(place - step))
            here = np.flatnonzero(weight)
            links, level_db = some[here], step / LEVELS_PER_DB
            at_db = snr_db[links] + (level_db - least_db[links])
            out[links] += weight[here] * tabulated(links, at_db, level_db)
        return out

    @staticmethod
    def _bytes_of(lengths: Lengths, shape: tuple[int, ...]) -> FloatArray:
        return np.broadcast_to(np.array(lengths.distinct, dtype=np.float64)[lengths.which], shape)

    def _make_curve(self, kind: tuple[int, int, float | None]) -> tuple[int, FloatArray]:
        """Return averages for length, elevation in degrees and least SNR, and where on the grid they begin."""
        length_bytes, degree, least_db = kind
        shadowing, fading = self._config.shadowing, self._config.fading
        grid_db = np.arange(*CURVE_RANGE_DB, CURVE_STEP_DB)
        success = self._sampled(grid_db, float(length_bytes), least_db)
        if shadowing.is_random:
            success = averaged_over_loss(success, CURVE_STEP_DB, shadowing.chance_below)
        if fading.is_random:
            angle, steps_alone = np.array([float(degree)]), self._steps_alone(least_db)
            below: ChanceBelow | None = getattr(fading, "chance_below", None)
            if steps_alone and below is not None:
                success = averaged_over_loss(
                    success, CURVE_STEP_DB, lambda loss_db: 1.0 - below(-loss_db, angle)
                )
            else:
                gain_db, weights = fading.rule(angle, FINER * PANELS if steps_alone else PANELS)
                grid_db, success = _smeared(grid_db, success, gain_db.ravel(), weights.ravel())
        grid_db, success = _trimmed(grid_db, np.clip(success, 0.0, 1.0))
        return round(float(grid_db[0]) * CURVE_STEPS_PER_DB), success

    def _sampled(self, grid_db: FloatArray, length_bytes: float, least_db: float | None) -> FloatArray:
        """Return chances of arrival on the grid; those about which they jump or bend are means over a step.

        So a jump is on average where it should be, wherever it lies between the points of the grid.
        """
        is_level_alone = least_db == LEVEL_ALONE
        level_db = 0.0 if is_level_alone else least_db

        def chance(snr_db: FloatArray) -> FloatArray:
            success = (
                np.ones_like(snr_db)
                if is_level_alone
                else 1.0 - self._config.error.per(snr_db, length_bytes, self._band)
            )
            return success if level_db is None else np.where(snr_db >= level_db, success, 0.0)

        success = chance(grid_db)
        breaks = [*(() if is_level_alone else self._config.error.breaks_db)]
        breaks += [] if level_db is None else [level_db]
        if breaks and (self._config.shadowing.is_random or self._config.fading.is_random):
            place = (np.array(breaks) - grid_db[0]) * CURVE_STEPS_PER_DB
            at = np.unique(np.clip(np.rint(place), 0, grid_db.size - 1).astype(np.intp))
            first = at[:, np.newaxis] - 0.5
            t, weights = split_gauss_legendre(place - first, 1)
            success[at] = np.sum(weights * chance(grid_db[0] + (first + t) * CURVE_STEP_DB), axis=1)
        return success


def averaged_over_loss(
    success: FloatArray, step_db: float, chance_below: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """Return E[1 - PER] over a random loss at each mean SNR of an even grid, by one convolution.

    Each small step of 1 - PER counts as often as the loss leaves the SNR above it. Beyond the grid 1 - PER
    goes on as at its ends.

    Args:
        success: 1 - PER on the grid, rising with the SNR.
        step_db: between the points of the grid.
        chance_below: distribution function of the loss in dB.
    """
    size = success.size
    lead_db: FloatArray = step_db * (np.arange(-size, size, dtype=np.float64) + 0.5)
    steps = np.fft.rfft(np.diff(success), 2 * size)
    row = np.fft.irfft(steps * np.fft.rfft(np.roll(chance_below(lead_db), -size)), 2 * size)[:size]
    # column j of the circular sum has the mean SNR half a step below grid point j + 1: put back by one
    return np.asarray(success[0] + np.concatenate((row[:1], row[:-1])))


def _smeared(
    grid_db: FloatArray, success: FloatArray, shift_db: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the curve averaged over random shifts of the SNR, on the part of the grid where it changes.

    Between the points of the grid, whose step is `CURVE_STEP_DB`, the curve is straight, and beyond it as at its ends:
    each shift moves it by a whole number of steps and a part of one, the same for all points. A shift past the whole
    grid (minus infinity, if fading leaves nothing) has the value of its end.
    """
    steps = np.diff(success, prepend=success[0])
    changing = np.flatnonzero(np.abs(steps) > 1e-13)
    if not changing.size:
        return grid_db, success
    low = grid_db[changing[0]] - np.max(shift_db) - 1.0
    high = grid_db[changing[-1]] - np.min(shift_db[weights > 1e-9]) + 1.0
    begin, end = np.searchsorted(grid_db, low), np.searchsorted(grid_db, high, side="right")
    within, whole = np.modf(np.clip(shift_db * CURVE_STEPS_PER_DB, -2.0 * grid_db.size, 2.0 * grid_db.size))
    first = begin + whole.astype(np.intp) - (within < 0.0)
    within += within < 0.0
    before = max(0, -int(np.min(first)))
    after = max(0, int(np.max(first)) + int(end - begin) + 1 - grid_db.size)
    curve = np.pad(success, (before, after), mode="edge")
    out = np.zeros(end - begin)
    for at, share, weight in zip((first + before).tolist(), within.tolist(), weights.tolist(), strict=True):
        out += weight * (1.0 - share) * curve[at : at + out.size]
        out += weight * share * curve[at + 1 : at + 1 + out.size]
    return grid_db[begin:end], np.clip(out, 0.0, 1.0)


def _trimmed(grid_db: FloatArray, success: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the curve without its flat ends."""
    inside = np.flatnonzero((success > 1e-9) & (success < success[-1] - 1e-9))
    if not inside.size:
        edge = int(np.searchsorted(success, 0.5))
        inside = np.array([max(edge - 1, 0), min(edge, len(success) - 1)])
    part = slice(max(inside[0] - 1, 0), inside[-1] + 2)
    return grid_db[part], success[part]
