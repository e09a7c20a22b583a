"""Packet error rates as they are written down, looked up: SNRs come in whole steps, so nothing is interpolated."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from channel.checks import FloatArray
from channel.link.tables.curves import Curves
from channel.link.tables.lengths import Lengths
from channel.link.tables.steps import STEPS_PER_DB, STEPS_PER_ONE, in_steps

LINKS_BEFORE_TABLE = 2048
"""A length that was asked for this often gets a table: about what the table costs."""
MAX_TABLES = 64
SCAN_DB = np.array([-3000.0, *np.arange(-300.0, 300.5), 3000.0])
"""Where the error rate is looked at to find out between which SNRs it changes."""
MAX_TABLE_DB = 120.0
SAME = 1e-12
"""Rates closer than this are the same before rounding."""


class PerTable:
    """The packet error rate of one error model in one band, rounded to 1e-7.

    Args:
        per: returns it for SNRs in dB and lengths in bytes; falls with the SNR and rises with the length.
    """

    def __init__(self, per: Callable[[FloatArray, FloatArray | float], FloatArray]) -> None:
        self._per = per
        self._asked: dict[int, int] = {}
        self._spans: dict[int, tuple[float, float] | None] = {}
        self._tables = Curves(STEPS_PER_DB, self._make)
        self._hopeless: dict[int, float] = {}

    def per(self, snr_db: FloatArray, lengths: Lengths) -> FloatArray:
        """Return the rate at SNRs that are whole steps of 0.001 dB."""
        if self._is_tabled(lengths, snr_db.size):
            which = self._tables.rows(lengths.distinct, lengths.which)
            return self._tables.at_steps(np.rint(snr_db * STEPS_PER_DB), which)
        return in_steps(self._per(snr_db, lengths.bytes_each), STEPS_PER_ONE)

    def hopeless_below_db(self, lengths: Lengths) -> FloatArray | float:
        """Return an SNR of each link up to which the rate is 1 for certain, dB; -inf if there is none."""
        if isinstance(lengths.which, int):
            return self._hopeless_db(lengths.distinct[0])
        return lengths.each(np.array([self._hopeless_db(length) for length in lengths.distinct]))

    def _hopeless_db(self, length: int) -> float:
        """Return it for the next power of two below, of which there are few: longer packets are lost rather."""
        short = 1 << (length.bit_length() - 1) if length else 0
        if short not in self._hopeless:
            hopeless = in_steps(self._per(SCAN_DB, float(short)), STEPS_PER_ONE) == 1.0
            count = int(np.argmin(hopeless))  # the first that is not: 0 if none is, and if all are
            self._hopeless[short] = float(SCAN_DB[count - 1]) if count else -math.inf
        return self._hopeless[short]

    def _is_tabled(self, lengths: Lengths, links: int) -> bool:
        """Count what is asked for; return whether there are tables for all these lengths."""
        share = links // len(lengths.distinct) + 1
        tabled = True
        for length in lengths.distinct:
            asked = self._asked[length] = self._asked.get(length, 0) + share
            tabled &= asked > LINKS_BEFORE_TABLE and self._span_db(length) is not None
        return tabled

    def _span_db(self, length: int) -> tuple[float, float] | None:
        """Return the whole dB between which the rate changes; None if they are too far apart, or too many asked."""
        if length not in self._spans:
            if len(self._spans) >= MAX_TABLES:
                return None
            rate = self._per(SCAN_DB, float(length))
            low = np.flatnonzero(np.abs(rate - rate[0]) > SAME)
            high = np.flatnonzero(np.abs(rate - rate[-1]) > SAME)
            first, last = (int(low[0]) - 1, int(high[-1]) + 1) if low.size else (1, 2)
            low_db, high_db = float(SCAN_DB[first]), float(SCAN_DB[last])
            self._spans[length] = (low_db, high_db) if high_db - low_db <= MAX_TABLE_DB else None
        return self._spans[length]

    def _make(self, length: int) -> tuple[int, FloatArray]:
        span_db = self._span_db(length)
        assert span_db is not None
        first, last = (round(end * STEPS_PER_DB) for end in span_db)
        snr_db = np.arange(first, last + 1, dtype=np.float64) / STEPS_PER_DB
        return first, in_steps(self._per(snr_db, float(length)), STEPS_PER_ONE)
