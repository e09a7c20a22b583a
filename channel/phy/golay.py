"""The binary Golay code (23,12): 12 bits of data in 23, any three of which may be wrong."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from channel.checks import FloatArray, finite

WORD_BITS: Final = 23
DATA_BITS: Final = 12
CORRECTED_BITS: Final = 3


def word_error(ber: ArrayLike) -> FloatArray:
    """Return the probability that a word is decoded wrongly: more than three of its bits are wrong.

    Exact, as the code is perfect: sum over k > 3 of C(23, k) p^k (1 - p)^(23 - k). Golay, Proc. IRE 37 (1949), p. 657.

    Args:
        ber: error rate of a bit on the air, in [0, 1], any shape; bits are independent.

    Raises:
        ChannelInputError: a rate outside [0, 1].
    """
    rate = finite("ber", ber, 0.0, 1.0)
    wrong = range(CORRECTED_BITS + 1, WORD_BITS + 1)
    terms = [math.comb(WORD_BITS, k) * rate**k * (1.0 - rate) ** (WORD_BITS - k) for k in wrong]
    return np.asarray(np.minimum(np.sum(terms, axis=0), 1.0))
