"""What a medium that takes time costs, as a ratio within one process: it hangs on no machine."""

import pytest

from benchmarks.channel.bench_media import Fleet

NODES = 50
ROUNDS = 5
MOST = 11.0
"""Measured: 4 to 5; with events at each receiver and one pass of numpy for each frame it was 13 to 17."""


@pytest.mark.slow
def test_csma_costs_a_few_times_what_the_same_receptions_cost_without_time() -> None:
    """CPU time of fifty nodes at 10 Hz over that of settling their packets a tick at a time, the best of rounds."""
    fleets = [Fleet(NODES), Fleet(NODES, is_ideal=True)]
    factors: list[list[float]] = [[], []]
    for fleet in fleets:
        fleet.measured(1.0)
    for _ in range(ROUNDS):
        for fleet, found in zip(fleets, factors, strict=True):
            found.append(fleet.measured(0.5)[1])
    csma, ideal = map(max, factors)
    assert ideal / csma < MOST
