"""Checks of what callers hand in: a mistake raises with the name, the value and the allowed range."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
"""Any shape, a 0-d result included: functions broadcast, so that scalars work too."""


class ChannelInputError(ValueError):
    """A value from the caller that cannot be: `name`, `value` and `allowed` say which and why."""

    def __init__(self, name: str, value: object, allowed: str) -> None:
        super().__init__(f"{name} = {value!r}: allowed is {allowed}")
        self.name = name
        self.value = value
        self.allowed = allowed


def _interval(low: float, high: float, low_open: bool) -> str:
    if math.isinf(low) and math.isinf(high):
        return "any finite number"
    left = f"{'>' if low_open else '>='} {low:g}" if math.isfinite(low) else ""
    right = f"<= {high:g}" if math.isfinite(high) else ""
    return "a finite number " + " and ".join(part for part in (left, right) if part)


def is_whole(value: object) -> bool:
    """Whether something is an integer of 0 or more, of Python's or of numpy's."""
    return isinstance(value, int | np.integer) and int(value) >= 0


def finite(
    name: str,
    value: ArrayLike,
    low: float = -math.inf,
    high: float = math.inf,
    *,
    low_open: bool = False,
) -> FloatArray:
    """Return `value` as a float array, every element of it finite and within [low, high].

    Args:
        name: what the caller calls it; goes into the error.
        value: a number or an array of numbers, any shape.
        low: lowest allowed value, itself allowed unless `low_open`.
        high: highest allowed value, itself allowed.
        low_open: whether `low` itself is refused.

    Raises:
        ChannelInputError: not a number, NaN, infinite or out of range; carries the first bad element.
    """
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ChannelInputError(name, value, _interval(low, high, low_open)) from error
    good = np.isfinite(array)
    if low > -math.inf:
        good &= (array > low) if low_open else (array >= low)
    if high < math.inf:
        good &= array <= high
    if not good.all():
        raise ChannelInputError(name, float(array[~good].flat[0]), _interval(low, high, low_open))
    return array


def vectors(name: str, value: ArrayLike, size: int) -> FloatArray:
    """Return `value` as finite vectors of `size` components in the last axis.

    Raises:
        ChannelInputError: another shape, or an element that is not finite.
    """
    array = finite(name, value)
    if array.ndim == 0 or array.shape[-1] != size:
        raise ChannelInputError(name, f"array of shape {array.shape}", f"shape (..., {size})")
    return array


def broadcast(**arrays: FloatArray) -> tuple[int, ...]:
    """Return the shape to which the named arrays broadcast.

    Raises:
        ChannelInputError: they do not; the error names each with its shape.
    """
    try:
        return np.broadcast_shapes(*(array.shape for array in arrays.values()))
    except ValueError as error:
        shapes = {name: array.shape for name, array in arrays.items()}
        raise ChannelInputError(" and ".join(arrays), shapes, "shapes that broadcast") from error
