"""Numbers rounded to what a viewer can show, in steps of powers of two: the bytes behind them are zero, and compress.

The tables have all bits of the truth, and the radio's numbers in their decimal steps.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

STEPS_PER_UNIT: Final = {
    "_deg": 2.0**30,
    "_rad": 2.0**20,
    "_m": 2.0**13,
    "_mps": 2.0**13,
    "_radps": 2.0**20,
    "_mps2": 2.0**13,
    "_dbm": 2.0**8,
    "_db": 2.0**8,
}
"""By the end of a column's name: 0.1 mm (also in degrees), 0.1 mm/s, 1e-6 rad, 0.004 dB."""
QUATERNION_STEPS: Final = 2.0**22
PER_STEPS: Final = 2.0**16
DISTANCE_STEPS: Final = 2.0**8
"""Distances of packets: 4 mm; they are many."""
_BY_NAME: Final = {"per": PER_STEPS, "distance_m": DISTANCE_STEPS}


def rounded(name: str, values: NDArray[Any]) -> NDArray[Any]:
    """A column's numbers in the steps that its name says; as they are if it says none."""
    steps = _steps_of(name)
    return values if steps is None else np.rint(values * steps) / steps


def _steps_of(name: str) -> float | None:
    if name in _BY_NAME:
        return _BY_NAME[name]
    if name.startswith("attitude_"):
        return QUATERNION_STEPS
    return STEPS_PER_UNIT.get(f"_{name.rsplit('_', 1)[-1]}")
