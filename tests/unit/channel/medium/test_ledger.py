"""Distance bins of a ledger: right one by one, and many at once with word of how far they are."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
import pytest
from scipy.stats import binom

from channel.medium.bins import Bins
from channel.medium.ledger import BINS_AT_ONCE, Ledger, LedgerError
from channel.medium.reception import EVERYBODY, FATES, Fate, Packets, Receptions

Row = tuple[int, int, float, bool, float]
"""Transmitter, receiver, distance, whether it arrived, what the model said of that."""


def sent(tx: Sequence[int], to: Sequence[int]) -> Packets:
    zero = np.zeros(len(tx), dtype=np.int64)
    return Packets(zero, np.array(tx), np.arange(len(tx)), zero + 40, np.array(to))


def receptions(rows: Sequence[Row]) -> Receptions:
    tx, rx, distance_m, delivered, chance = (np.array(column) for column in zip(*rows, strict=True))
    fate = np.where(delivered, FATES.index(Fate.DELIVERED), FATES.index(Fate.CHANNEL_ERASURE))
    nan = np.full(len(rows), np.nan)
    packets = sent(tx.tolist(), rx.tolist())
    return Receptions(
        packets, np.arange(len(rows)), rx, distance_m, nan, nan, nan, chance, fate.astype(np.uint8)
    )


def filled(nodes: int, bins: int) -> Ledger:
    """A ledger in which every link has so many bins with two packets each."""
    ledger = Ledger([str(i) for i in range(nodes)])
    for tx in range(nodes):
        for rx in range(nodes):
            if tx != rx:
                rows = [
                    (tx, rx, 20.0 * i + 3.0, k == 0, (i % 10) / 10 + 0.05)
                    for i in range(bins)
                    for k in range(2)
                ]
                ledger.settle(receptions(rows))
    return ledger


def test_each_bin_has_its_own_interval() -> None:
    ledger = Ledger([str(i) for i in range(201)])
    for n, chance in ((40, 0.5), (7, 0.93), (200, 0.01)):
        ledger.settle(receptions([(n, 0, 20.0 * n + 1.0, k < n // 2, chance) for k in range(n)]))
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
    assert Ledger(["a"]).bins() == []


def test_bins_stand_by_the_names_of_their_ends_and_by_distance() -> None:
    ledger = Ledger(["b", "a", "10", "9"])
    rows = [(0, 1, 50.0), (1, 0, 20.0), (2, 3, 1e6), (2, 3, 19.999), (3, 2, 0.0), (0, 1, 5.0)]
    ledger.settle(receptions([(tx, rx, distance, True, 1.0) for tx, rx, distance in rows]))
    found = [(b.tx, b.rx, b.distance_min_m) for b in ledger.bins()]
    tens = [("10", "9", 0.0), ("10", "9", 1e6), ("9", "10", 0.0)]
    assert found == [*tens, ("a", "b", 20.0), ("b", "a", 0.0), ("b", "a", 40.0)]


def test_packets_to_everybody_and_to_one_are_booked_at_their_receivers() -> None:
    ledger = Ledger("abc", causes=("transport",))
    ledger.send(sent([0, 0, 2, 1], [EVERYBODY, EVERYBODY, 0, EVERYBODY]))
    ledger.lose("a", "transport", 5)
    ledger.lose("c", "transport", 2, to="b")
    assert ledger.sent.tolist() == [[0, 7, 7], [1, 0, 1], [1, 2, 0]]
    ledger.settle(receptions([(0, 1, 9.0, True, 0.5), (0, 1, 9.0, False, 0.5), (2, 0, 1.0, True, 1.0)]))
    ledger.check(in_flight=4)
    account = ledger.links["a", "b"]
    assert (account.sent, account.delivered, account.lost) == (7, 1, {"channel_erasure": 1, "transport": 5})
    assert set(ledger.links) == {("a", "b"), ("a", "c"), ("b", "a"), ("b", "c"), ("c", "a"), ("c", "b")}
    ledger.settle(receptions([(2, 0, 1.0, True, 1.0)]))
    with pytest.raises(LedgerError, match="c -> a: more fates than packets"):
        ledger.check()


def test_counts_by_key_are_those_of_a_dictionary() -> None:
    rng = np.random.Generator(np.random.PCG64(5))
    bins, plain = Bins(2), {}
    for size in (0, 1, 5000, 30, 60_000):
        keys = rng.integers(0, 40_000, size) << rng.integers(0, 22)
        values = rng.integers(-5, 100, size)
        bins.add(keys, np.ones_like(keys), values)
        for key, value in zip(keys.tolist(), values.tolist(), strict=True):
            count, total = plain.get(key, (0, 0))
            plain[key] = count + 1, total + value
    keys, counts = bins.rows()
    assert keys.tolist() == sorted(plain)
    assert [tuple(row) for row in counts.T.tolist()] == [plain[key] for key in sorted(plain)]
