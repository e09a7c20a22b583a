"""Block fading: one draw per coherence time, for each pair; the next is independent of it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.draws import uniform_from_words
from channel.fading.link_words import Words, counted
from channel.numbers.units import SPEED_OF_LIGHT_MPS

CLARKE = 9.0 / (16.0 * math.pi)
"""Coherence time times Doppler spread (Rappaport, eq. 5.40.b)."""
NS_PER_S = 1e9


def coherence_time_s(speed_mps: FloatArray, frequency_hz: FloatArray | float, longest_s: float) -> FloatArray:
    """Return 9 c / (16 pi f v), at most `longest_s` (Clarke; Rappaport, eq. 5.40.b)."""
    doppler_hz = np.multiply(speed_mps, np.divide(frequency_hz, SPEED_OF_LIGHT_MPS))
    return np.asarray(np.minimum(CLARKE / np.maximum(doppler_hz, CLARKE / longest_s), longest_s))


def coherence_octave(coherence_s: FloatArray) -> NDArray[np.int64]:
    """Return the lengths of blocks as powers of two in ns: coherence times, rounded down to these.

    A speed that wavers then does not draw anew each time.
    """
    _, exponent = np.frexp(np.maximum(np.floor(coherence_s * NS_PER_S), 1.0))
    return np.asarray(exponent - 1, dtype=np.int64)


def block_uniforms(
    words: Words, sim_time_ns: NDArray[np.int64], coherence_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return two uniform numbers for each pair's block of time, shape (L,).

    Args:
        words: of the pairs.
        sim_time_ns: instants; before 0 it is as at 0.
        coherence_s: of the pairs.
    """
    octave = coherence_octave(coherence_s)
    number = (np.maximum(sim_time_ns, 0) >> octave).astype(np.uint64)
    block = counted(counted(words, octave.astype(np.uint64)), number)
    return uniform_from_words(counted(block, 0)), uniform_from_words(counted(block, 1))
