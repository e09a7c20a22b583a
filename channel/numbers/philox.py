"""Philox4x64-10 for many keys at once: the words that numpy's `Philox` gives, without a generator for each key.

Salmon, Moraes, Dror, Shaw, "Parallel random numbers: as easy as 1, 2, 3" (SC 2011), sec. 3.3: ten rounds, each of two
64-bit products of which both halves are used. The counter's upper three words are 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Words = NDArray[np.uint64]

WORDS_PER_COUNT = 4
ROUNDS = 10
MULTIPLIERS = (0xD2E7470EE14C6C93, 0xCA5A826395121157)
WEYL = (0x9E3779B97F4A7C15, 0xBB67AE8584CAA73B)
MASK_64 = 2**64 - 1
BEFORE_ZERO = (MASK_64,) * WORDS_PER_COUNT
FEW = 24
"""Up to so many keys Python's own integers are faster than arrays."""

_FACTORS = np.array(MULTIPLIERS, dtype=np.uint64)[:, np.newaxis]
_HALF = np.uint64(32)
_LOW_MASK = np.uint64(0xFFFFFFFF)
_FACTORS_LOW, _FACTORS_HIGH = _FACTORS & _LOW_MASK, _FACTORS >> _HALF
_STEPS = np.array(WEYL, dtype=np.uint64)[:, np.newaxis]


def philox_words(keys: Words, counters: NDArray[np.int64]) -> Words:
    """Return the four words of each key at its counter.

    Args:
        keys: shape (2, L).
        counters: shape (L,), 0 to 2^63 - 1.

    Returns:
        Shape (4, L).
    """
    if len(counters) > FEW:
        return _of_many(keys, counters)
    rows = [_of_one(*each) for each in zip(*keys.tolist(), counters.tolist(), strict=True)]
    return np.array(rows, dtype=np.uint64).reshape(-1, WORDS_PER_COUNT).T


def _of_one(key_0: int, key_1: int, counter: int) -> tuple[int, int, int, int]:
    a, b, c, d = counter, 0, 0, 0
    for _ in range(ROUNDS):
        from_a, from_c = MULTIPLIERS[0] * a, MULTIPLIERS[1] * c
        a, b = (from_c >> 64) ^ b ^ key_0, from_c & MASK_64
        c, d = (from_a >> 64) ^ d ^ key_1, from_a & MASK_64
        key_0, key_1 = (key_0 + WEYL[0]) & MASK_64, (key_1 + WEYL[1]) & MASK_64
    return a, b, c, d


def _of_many(keys: Words, counters: NDArray[np.int64]) -> Words:
    """Words 0 and 2, which are multiplied, lie in one array of two rows, words 1 and 3 in another."""
    multiplied, other = np.zeros(keys.shape, np.uint64), np.zeros(keys.shape, np.uint64)
    multiplied[0] = counters
    round_keys = keys.copy(order="C")
    high, *scratch = (np.empty(keys.shape, np.uint64) for _ in range(4))
    for _ in range(ROUNDS):
        _multiply(multiplied, high, *scratch)
        np.bitwise_xor(high[::-1], other, out=other)
        np.bitwise_xor(other, round_keys, out=other)
        multiplied, other = other, multiplied[::-1]
        np.add(round_keys, _STEPS, out=round_keys)
    return np.stack((multiplied[0], other[0], multiplied[1], other[1]))


def _multiply(value: Words, high: Words, low_part: Words, middle: Words, carry: Words) -> None:
    """Put the high halves of value times factor into `high` and the low halves into `value`, 32 bits at a time."""
    np.bitwise_and(value, _LOW_MASK, out=low_part)
    np.right_shift(value, _HALF, out=high)
    np.multiply(value, _FACTORS, out=value)
    np.multiply(low_part, _FACTORS_LOW, out=carry)
    np.right_shift(carry, _HALF, out=carry)
    np.multiply(high, _FACTORS_LOW, out=middle)
    np.add(middle, carry, out=middle)
    np.multiply(low_part, _FACTORS_HIGH, out=low_part)
    np.bitwise_and(middle, _LOW_MASK, out=carry)
    np.add(low_part, carry, out=low_part)
    np.right_shift(low_part, _HALF, out=low_part)
    np.right_shift(middle, _HALF, out=middle)
    np.multiply(high, _FACTORS_HIGH, out=high)
    np.add(high, middle, out=high)
    np.add(high, low_part, out=high)


class PhiloxRuns:
    """Words of one key at successive counters, by numpy's generator: a single one, set to where each run begins."""

    def __init__(self) -> None:
        self._philox = np.random.Philox(key=0)
        self._counter = np.zeros(WORDS_PER_COUNT, dtype=np.uint64)
        self._key = np.zeros(2, dtype=np.uint64)
        self._state = self._philox.state
        self._state["state"] = {"counter": self._counter, "key": self._key}
        self._state["buffer_pos"] = WORDS_PER_COUNT

    def words(self, key: Words, first: int, count: int) -> Words:
        """Return the words of `count` counters from `first` on, shape (count, 4)."""
        self._counter[:] = (first - 1, 0, 0, 0) if first else BEFORE_ZERO  # numpy steps it before it draws
        self._key[:] = key
        self._philox.state = self._state
        return self._philox.random_raw(count * WORDS_PER_COUNT).reshape(count, WORDS_PER_COUNT)
