"""What was lost: causes over sim time, who lost what just now, and whose latest packet reached whom."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from bridge.bus.messages import Fates

SPAN_NS = 1_000_000_000
"""Of one count over time, at first; it doubles when there are too many."""
SPANS_MAX = 600
DELIVERED = 0
"""Place of `delivered` among the causes of `Fates`."""


class Losses:
    """Counts of all fates that were seen on one radio network, for ``nodes`` nodes."""

    def __init__(self, nodes: int) -> None:
        self.known = np.zeros((nodes, nodes), dtype=np.bool_)
        """[rx, tx]: whether a packet was meant for rx."""
        self.heard = np.zeros((nodes, nodes), dtype=np.bool_)
        """[rx, tx]: whether the latest one arrived."""
        self.delay_s = np.zeros((nodes, nodes))
        """[rx, tx]: of the latest packet that arrived, since its stamp; 0 if none did, or nothing takes time."""
        self.total: Counter[str] = Counter()
        """Packets by fate, since somebody looks."""
        self.lengths: Counter[int] = Counter()
        """The same by length, bytes."""
        self.since_s: float | None = None
        self._nodes = nodes
        self._span_ns = SPAN_NS
        self._spans: dict[int, Counter[str]] = {}
        self._fresh: Counter[tuple[int, int]] = Counter()

    def take(self, fates: Fates) -> None:
        """Take what became of the packets of a tick."""
        if len(fates.node) != self._nodes:
            return
        now_ns = fates.header.stamp.ns
        if self.since_s is None:
            self.since_s = now_ns / 1e9
        fate = np.frombuffer(fates.fate, dtype=np.uint8)
        tx, rx = np.asarray(fates.tx, dtype=np.intp), np.asarray(fates.rx, dtype=np.intp)
        self.known[rx, tx] = True
        self.heard[rx, tx] = fate == DELIVERED
        if len(fates.delay_s) == len(fate):
            came = fate == DELIVERED
            self.delay_s[rx[came], tx[came]] = np.asarray(fates.delay_s)[came]
        counts = np.bincount(fate, minlength=len(fates.cause)).tolist()
        found = {cause: n for cause, n in zip(fates.cause, counts, strict=False) if n}
        self.total.update(found)
        self._spans.setdefault(now_ns // self._span_ns, Counter()).update(found)
        if len(self._spans) > SPANS_MAX:
            self._widen()
        lengths, counted = np.unique(np.asarray(fates.length_bytes), return_counts=True)
        self.lengths.update(dict(zip(lengths.tolist(), counted.tolist(), strict=True)))
        lost = np.flatnonzero(fate != DELIVERED)
        self._fresh.update(zip(tx[lost].tolist(), rx[lost].tolist(), strict=True))

    def _widen(self) -> None:
        self._span_ns *= 2
        wider: dict[int, Counter[str]] = {}
        for number, counts in self._spans.items():
            wider.setdefault(number // 2, Counter()).update(counts)
        self._spans = wider

    def over_time(self) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
        """Return when each span begins, s, and by cause of loss the share of its packets that were lost to it."""
        numbers = sorted(self._spans)
        sums = [max(1, self._spans[number].total()) for number in numbers]
        causes = [cause for cause in self.total if cause != "delivered"]
        shares = {
            cause: np.array(
                [self._spans[number][cause] / total for number, total in zip(numbers, sums, strict=True)]
            )
            for cause in causes
        }
        return np.array(numbers, dtype=np.float64) * self._span_ns / 1e9, shares

    def fresh(self) -> Counter[tuple[int, int]]:
        """Return how many packets of each (tx, rx) were lost since the last call."""
        fresh, self._fresh = self._fresh, Counter()
        return fresh
