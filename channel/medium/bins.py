"""Counts by link and distance, in columns: a hash table of whole numbers, as most pairs never see most distances."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FIRST_SLOTS = 1024
EMPTY = -1
SPREAD = 0x9E3779B97F4A7C15
"""2^64 over the golden ratio: neighbouring keys fall far apart (Knuth, TAOCP vol. 3, sec. 6.4)."""

Ints = NDArray[np.int64]


class Bins:
    """Rows of counters by a key, which is a whole number of at least 0.

    Args:
        counters: how many counters a row has.
    """

    def __init__(self, counters: int) -> None:
        self._bits = FIRST_SLOTS.bit_length() - 1
        self._keys = np.full(FIRST_SLOTS, EMPTY, dtype=np.int64)
        self._counts = np.zeros((counters, FIRST_SLOTS), dtype=np.int64)

    def add(self, keys: Ints, *values: Ints) -> None:
        """Add to the counters of each key; a key may come more than once."""
        slots = self._slots(keys)
        for counter, value in zip(self._counts, values, strict=True):
            np.add.at(counter, slots, value)

    def rows(self) -> tuple[Ints, Ints]:
        """Return all keys in rising order, shape (B,), and their counters, shape (counters, B)."""
        used = np.flatnonzero(self._keys != EMPTY)
        order = used[np.argsort(self._keys[used])]
        return self._keys[order], self._counts[:, order]

    def _slots(self, keys: Ints) -> NDArray[np.intp]:
        """Return the slot of each key; new keys get one, the next free one from where they begin to look."""
        slots = self._start(keys)
        open_keys = np.flatnonzero(self._keys[slots] != keys)
        while open_keys.size:
            here = slots[open_keys]
            free = self._keys[here] == EMPTY
            if free.any():
                self._keys[here[free]] = keys[
                    open_keys[free]
                ]  # of two keys for one slot the last one gets it
                if 2 * np.count_nonzero(self._keys != EMPTY) > self._keys.size:
                    self._grow()
                    return self._slots(keys)
            open_keys = open_keys[self._keys[here] != keys[open_keys]]
            slots[open_keys] = (slots[open_keys] + 1) & (self._keys.size - 1)
        return slots

    def _start(self, keys: Ints) -> NDArray[np.intp]:
        spread = keys.astype(np.uint64) * np.uint64(SPREAD)
        return (spread >> np.uint64(64 - self._bits)).astype(np.intp)

    def _grow(self) -> None:
        keys, counts = self.rows()
        self._bits += 2
        self._keys = np.full(1 << self._bits, EMPTY, dtype=np.int64)
        self._counts = np.zeros((len(counts), 1 << self._bits), dtype=np.int64)
        self._counts[:, self._slots(keys)] = counts
