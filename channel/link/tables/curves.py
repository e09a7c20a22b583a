"""Curves at an even step, many of them end to end in one array: values for thousands of links in one look-up."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray

MAX_VALUES = 1 << 22
"""Of all curves together; beyond it they are made anew as they are asked for."""

Key = TypeVar("Key", bound=Hashable)
Rows = int | NDArray[np.intp]
"""Which curve: one for all links, or one for each."""


class Curves(Generic[Key]):
    """Functions of one variable, given by their values at whole multiples of a step; constant beyond their ends.

    Args:
        steps_per_unit: values per unit of the variable.
        make: returns the first multiple of the step and the values from there on, at least two, for a key.
    """

    def __init__(self, steps_per_unit: float, make: Callable[[Key], tuple[int, FloatArray]]) -> None:
        self._steps_per_unit = steps_per_unit
        self._make = make
        self._clear()

    def _clear(self) -> None:
        self._rows: dict[Key, int] = {}
        self._ends_of_row: list[tuple[float, ...]] = []
        self._columns = np.empty((3, 0))
        self._flat = np.empty(0)
        self._rise = np.empty(0)

    def rows(self, keys: Sequence[Key], which: Rows) -> Rows:
        """Return the curve that each link uses; curves that are not there yet are made.

        Args:
            keys: of the curves in use, each once.
            which: place in `keys`, one for all links or one for each.
        """
        if isinstance(which, int) and keys[which] in self._rows:
            return self._rows[keys[which]]
        missing = [key for key in keys if key not in self._rows]
        if missing:
            if self._flat.size > MAX_VALUES:
                self._clear()
                missing = list(keys)
            self._add(missing)
        if isinstance(which, int):
            return self._rows[keys[which]]
        rows: NDArray[np.intp] = np.array([self._rows[key] for key in keys], dtype=np.intp)[which]
        return rows

    def _add(self, keys: Sequence[Key]) -> None:
        curves = [self._make(key) for key in keys]
        start = self._flat.size
        for key, (first, values) in zip(keys, curves, strict=True):
            self._rows[key] = len(self._ends_of_row)
            self._ends_of_row.append((float(first), float(first + values.size - 1), float(start - first)))
            start += values.size
        self._columns = np.array(self._ends_of_row).T
        self._flat = np.concatenate((self._flat, *(values for _, values in curves)))
        self._rise = np.diff(
            self._flat, append=0.0
        )  # nothing goes on from the last value of a curve: it is met

    def at_steps(self, steps: FloatArray, row: Rows) -> FloatArray:
        """Return values at whole multiples of the step."""
        first, last, offset = self._ends(row)
        index = np.minimum(np.maximum(steps, first), last)
        index += offset
        return self._flat.take(index.astype(np.intp))

    def between(self, value: FloatArray, row: Rows) -> FloatArray:
        """Return values at any place, linear between the steps."""
        first, last, offset = self._ends(row)
        where = np.asarray(value * self._steps_per_unit)
        np.maximum(where, first, out=where)
        np.minimum(where, last, out=where)
        where += offset
        left = where.astype(np.intp)
        where -= left
        where *= self._rise.take(left)
        where += self._flat.take(left)
        return where

    def _ends(self, row: Rows) -> tuple[FloatArray | float, ...]:
        """Return the first and last step of each curve, and what is to be added to a step for its place."""
        if isinstance(row, int):
            return self._ends_of_row[row]
        return tuple(self._columns[:, row])
