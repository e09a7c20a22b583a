"""The steps to which the numbers of a packet are rounded: those in which the record of a run writes them.

The last bits of a logarithm or a power depend on the processor and on the version of numpy; where they decide something
or are written down, that shows. So numbers are rounded before anything follows from them: what is written and what is
decided is the same number.
"""

from __future__ import annotations

import numpy as np

from channel.checks import FloatArray

STEPS_PER_M = 1e3
STEPS_PER_DB = 1e3
STEPS_PER_ONE = 1e7
"""Of probabilities."""


def in_steps(value: FloatArray, steps_per_unit: float) -> FloatArray:
    """Return values rounded to whole steps: the doubles nearest to these decimals, and a zero without a sign.

    Multiplication, rounding and division have one result on every machine (IEEE 754).
    """
    rounded: FloatArray = np.rint(value * steps_per_unit) / steps_per_unit + 0.0
    return rounded
