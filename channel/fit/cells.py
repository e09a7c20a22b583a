"""Packets put together of which a fit says the same: a likelihood is computed once for each cell of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray

WIDTH_DECADES = 5e-5
"""Of a cell, along the logarithm of the distance: over it the power of a law of exponent 4 falls by 0.002 dB."""


@dataclass(frozen=True, slots=True)
class Alike:
    """Rows with the same values.

    Attributes:
        of_row: the group of each row, shape (rows,).
        first: a row of each group, shape (groups,).
        count: how many rows each has.
    """

    of_row: NDArray[np.intp]
    first: NDArray[np.intp]
    count: FloatArray

    def mean(self, values: FloatArray) -> FloatArray:
        """Return the mean over the rows of each group."""
        return np.bincount(self.of_row, values) / self.count


def alike(*columns: NDArray[Any]) -> Alike:
    """Return rows in groups with the same values in all columns, sorted by them, the first one first; NaN is NaN."""
    order = np.lexsort(columns[::-1])
    begins = np.zeros(order.size, dtype=bool)
    begins[:1] = True
    for column in columns:
        ordered = column[order]
        unknown = ordered != ordered
        begins[1:] |= (ordered[1:] != ordered[:-1]) & ~(unknown[1:] & unknown[:-1])
    of_row = np.empty_like(order)
    of_row[order] = np.cumsum(begins) - 1
    first = np.flatnonzero(begins)
    count = np.diff(first, append=order.size)
    return Alike(of_row, order[first], count.astype(np.float64))


def by_distance(
    decades: FloatArray, length_bytes: FloatArray, delivered: NDArray[np.bool_], rssi_dbm: FloatArray
) -> Alike:
    """Return packets of about one distance, of one length and outcome and with one reading, or none.

    The mean distance of its packets stands for a cell's: what is neglected goes with the square of the width.
    """
    place = np.floor(decades / WIDTH_DECADES)
    return alike(length_bytes, delivered, rssi_dbm, place)
