"""How much of an emission a receiver takes in: its spectrum times the receiver's filter, integrated.

An emission is flat within its bandwidth, with a mask beyond; a filter likewise, unless the radio has one of its own.
Both are rows of an offset in Hz and dB, linear between rows and alike on both sides, so that the integral has a closed
form.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from channel.checks import FloatArray

MASK = ((0.5, 0.0), (0.55, -20.0), (1.0, -28.0), (1.5, -40.0), (2.5, -40.0))
"""Offsets in bandwidths and dB: the mask of OFDM in 20 MHz (IEEE 802.11-2020, sec. 17.3.9.3), flat to the band's edge.

It ends at 250 % of the bandwidth, where what is left is called spurious (ITU-R SM.329): that is left out.
"""
DECADE = math.log(10.0) / 10.0
Rows = Sequence[tuple[float, float]]


def masked(bandwidth_hz: float) -> Rows:
    """Return the rows of an emission, or of a filter, of a bandwidth."""
    return tuple((share * bandwidth_hz, level_db) for share, level_db in MASK)


def reaches(offset_hz: float, bandwidth_hz: float, filter_rows: Rows) -> bool:
    """Return whether an emission comes as near to a receiver's carrier as the last row of its filter."""
    return abs(offset_hz) - masked(bandwidth_hz)[-1][0] <= filter_rows[-1][0]


def captured_db(offset_hz: float, bandwidth_hz: float, filter_rows: Rows) -> float:
    """Return the share of an emission's power that passes a filter, dB, at most 0.

    Args:
        offset_hz: of the emission's carrier from the receiver's.
        bandwidth_hz: of the emission.
        filter_rows: of the receiver; constant beyond the last one.
    """
    edges, levels_db = _both_sides(masked(bandwidth_hz))
    steps, passed_db = _both_sides(filter_rows)
    inside = steps[np.abs(steps - offset_hz) < edges[-1]] - offset_hz
    at = np.union1d(edges, inside)
    emitted_db = np.interp(at, edges, levels_db)
    kept_db = emitted_db + np.interp(at + offset_hz, steps, passed_db)
    return 10.0 * math.log10(_integral(at, kept_db) / _integral(at, emitted_db))


def _both_sides(rows: Rows) -> tuple[FloatArray, FloatArray]:
    offsets, levels_db = np.asarray(rows).T
    if offsets[0] == 0.0:
        return np.concatenate((-offsets[:0:-1], offsets)), np.concatenate((levels_db[:0:-1], levels_db))
    return np.concatenate((-offsets[::-1], offsets)), np.concatenate((levels_db[::-1], levels_db))


def _integral(at: FloatArray, level_db: FloatArray) -> float:
    """Return the integral of 10^(level / 10), the level linear between points."""
    power, rise = np.exp(DECADE * level_db), DECADE * np.diff(level_db)
    flat = np.abs(rise) < 1e-9
    mean = np.where(flat, power[:-1], np.diff(power) / np.where(flat, 1.0, rise))
    return float(np.sum(mean * np.diff(at)))
