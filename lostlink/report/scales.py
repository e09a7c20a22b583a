"""Steps that people read well, and numbers as JSON has them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

MANTISSAS = (1.0, 2.0, 3.0, 6.0, 10.0)
"""6 and 60 m are the steps of the paper's box plots."""


def nice_step(range_: float, steps_max: int, least: float) -> float:
    """The smallest of 1, 2, 3, 6 times a power of ten, at least ``least``, of which ``steps_max`` cover the range."""
    wanted = max(range_ / steps_max, least)
    power = 10.0 ** math.floor(math.log10(wanted))
    return next(m * power for m in MANTISSAS if m * power >= wanted * (1 - 1e-9))


def plain(value: Any) -> Any:
    """In JSON's types: arrays as lists, what is no number as null."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, dict):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def rows_of(columns: dict[str, Any]) -> list[dict[str, Any]]:
    """A mapping per row of columns."""
    values = [np.asarray(column).tolist() for column in columns.values()]
    return [dict(zip(columns, row, strict=True)) for row in zip(*values, strict=True)]
