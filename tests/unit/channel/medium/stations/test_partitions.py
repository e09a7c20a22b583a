"""Nodes that are apart for a while: what one side sends is lost on the other, and nothing else changes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from channel.medium.medium import Fate
from channel.medium.stations.partitions import Partition, Partitions
from tests.unit.channel.medium.stations.test_switches import MS, NODES, OFF, flown, medium_of

PARTS = (
    Partition([("0", "1"), ("2",)], 300 * MS, 900 * MS),
    Partition([("0",), ("1", "elsewhere")], 800 * MS),
)


def are_apart(tx: str, rx: str, at_ns: int) -> bool:
    """By hand."""
    first = {tx, rx} in ({"0", "2"}, {"1", "2"}) and 300 * MS <= at_ns < 900 * MS
    return first or ({tx, rx} == {"0", "1"} and at_ns >= 800 * MS)


def test_whoever_is_in_different_groups_is_apart_and_the_others_are_not() -> None:
    parts = Partitions(NODES, PARTS)
    assert parts.are_used
    for at_ns in (0, 300 * MS - 1, 300 * MS, 800 * MS, 900 * MS - 1, 900 * MS, 10**15):
        for tx, here in enumerate(NODES):
            for rx, there in enumerate(NODES):
                assert parts.are_apart(tx, rx, at_ns) == are_apart(here, there, at_ns), (here, there, at_ns)
    none = Partitions(NODES)
    assert not none.are_used
    assert not none.are_apart(0, 1, 0)


def test_links_are_asked_together_each_at_its_instant() -> None:
    tx, rx = np.array([0, 0, 1, 3]), np.array([2, 2, 2, 2])
    when_ns = np.array([0, 300, 300, 300]) * MS
    assert Partitions(NODES, PARTS).between(tx, rx, when_ns).tolist() == [False, True, True, False]


@pytest.mark.parametrize("switchings", [(), OFF])
def test_what_crosses_is_lost_and_all_else_is_as_without(
    switchings: tuple[tuple[str, int, bool], ...],
) -> None:
    """Also where shadowing, fading and bursts last: what is not drawn moves no other draw."""
    whole, _ = flown(medium_of(), switchings)
    parted, ledger = flown(medium_of(partitions=PARTS), switchings)
    lost = 0
    for before, after in zip(whole, parted, strict=True):
        crosses = are_apart(before.tx, before.rx, before.sim_time_ns) and before.fate is not Fate.RADIO_OFF
        if crosses:
            lost += 1
            assert after.fate is Fate.PARTITIONED
            assert after.probability_of_delivery == 0.0
            assert math.isnan(after.distance_m)
            assert math.isnan(after.snr_db)
        else:
            assert repr(after) == repr(before)
    counts = sum(account.lost["partitioned"] for account in ledger.links.values())
    assert counts == lost > 0
    decided = sum(fate not in (Fate.PARTITIONED, Fate.RADIO_OFF) for fate in (row.fate for row in parted))
    assert sum(each.sent for each in ledger.bins()) == decided
