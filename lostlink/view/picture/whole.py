"""Numbers as the browser's map is sent them: whole."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

UNKNOWN = -(2**31)
"""Stands for a number that is not known."""


def whole(values: NDArray[Any], scale: float, unknown: int = UNKNOWN) -> list[int]:
    """``values`` times ``scale`` as whole numbers, row by row."""
    flat = np.rint(np.asarray(values, dtype=np.float64).ravel() * scale)
    numbers: list[int] = (
        np.where(np.isfinite(flat), np.clip(flat, -2e9, 2e9), unknown).astype(np.int64).tolist()
    )
    return numbers
