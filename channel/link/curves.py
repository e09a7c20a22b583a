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
        self._flat = np.empty(0)
        self._first = np.empty(0)
        self._last = np.empty(0)
        self._offset = np.empty(0, dtype=np.intp)

    def rows(self, keys: Sequence[Key]) -> NDArray[np.intp]:
        """Return the row of each key; curves that are not there yet are made. Rows hold until the next call."""
        missing = [key for key in dict.fromkeys(keys) if key not in self._rows]
        if missing and self._flat.size > MAX_VALUES:
            self._clear()
            missing = list(dict.fromkeys(keys))
        if missing:
            self._add(missing)
        return np.array([self._rows[key] for key in keys], dtype=np.intp)

    def _add(self, keys: Sequence[Key]) -> None:
        curves = [self._make(key) for key in keys]
        starts = self._flat.size + np.cumsum([0, *(values.size for _, values in curves)])
        first = np.array([start for start, _ in curves], dtype=np.float64)
        sizes = np.diff(starts)
        self._rows |= {key: len(self._first) + i for i, key in enumerate(keys)}
        self._first = np.concatenate((self._first, first))
        self._last = np.concatenate((self._last, first + sizes - 1))
        self._offset = np.concatenate((self._offset, starts[:-1]))
        self._flat = np.concatenate((self._flat, *(values for _, values in curves)))

    def at_steps(self, steps: FloatArray, row: Rows) -> FloatArray:
        """Return values at whole multiples of the step."""
        first = self._first[row]
        index = np.minimum(np.maximum(steps, first), self._last[row])
        index -= first
        at = index.astype(np.intp)
        at += self._offset[row]
        return self._flat.take(at)

    def between(self, value: FloatArray, row: Rows) -> FloatArray:
        """Return values at any place, linear between the steps."""
        first = self._first[row]
        where = value * self._steps_per_unit
        np.maximum(where, first, out=where)
        np.minimum(where, self._last[row], out=where)
        where -= first
        left = np.minimum(where.astype(np.intp), (self._last[row] - first).astype(np.intp) - 1)
        where -= left
        left += self._offset[row]
        here = self._flat.take(left)
        left += 1
        rise = self._flat.take(left)
        rise -= here
        rise *= where
        rise += here
        return rise
