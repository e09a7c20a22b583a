"""Distance bins of a ledger: right one by one, and many at once with word of how far they are."""

from __future__ import annotations

import time

import pytest
from scipy.stats import binom

from channel.medium.ledger import BINS_AT_ONCE, Ledger
from channel.medium.reception import Fate, Reception


def reception(tx: int, rx: int, distance_m: float, *, delivered: bool, chance: float) -> Reception:
    fate = Fate.DELIVERED if delivered else Fate.CHANNEL_ERASURE
    return Reception(0, str(tx), str(rx), 0, 40, distance_m, -80.0, 10.0, 1.0 - chance, fate, chance)


def filled(nodes: int, bins: int) -> Ledger:
    """A ledger in which every link has so many bins with two packets each."""
    ledger = Ledger()
    for tx in range(nodes):
        for rx in range(nodes):
            if tx != rx:
                for index in range(bins):
                    chance = (index % 10) / 10 + 0.05
                    ledger.settle(
                        reception(tx, rx, 20.0 * index + 3.0, delivered=k == 0, chance=chance)
                        for k in range(2)
                    )
    return ledger


def test_each_bin_has_its_own_interval() -> None:
    ledger = Ledger()
    for n, chance in ((40, 0.5), (7, 0.93), (200, 0.01)):
        for k in range(n):
            ledger.settle([reception(n, 0, 20.0 * n + 1.0, delivered=k < n // 2, chance=chance)])
    bins = {b.sent: b for b in ledger.bins()}
    for n, chance in ((40, 0.5), (7, 0.93), (200, 0.01)):
        found = bins[n]
        assert found.delivered == n // 2
        assert found.predicted == pytest.approx(chance)
        assert found.ci99_low == binom.ppf(0.005, n, chance) / n
        assert found.ci99_high == binom.ppf(0.995, n, chance) / n
        assert (found.distance_min_m, found.distance_max_m) == (20.0 * n, 20.0 * n + 20.0)


def test_many_bins_are_told_of_as_they_get_on_and_cost_little_each() -> None:
    ledger = filled(nodes=15, bins=60)
    shares: list[float] = []
    begin = time.process_time()
    bins = ledger.bins(shares.append)
    took_s = time.process_time() - begin
    assert len(bins) == 15 * 14 * 60
    assert shares == [begin / len(bins) for begin in range(0, len(bins), BINS_AT_ONCE)]
    assert took_s < 50e-6 * len(bins)  # it was 200 us each, and a large run lost its record over that


def test_an_empty_ledger_has_no_bins() -> None:
    assert Ledger().bins() == []
