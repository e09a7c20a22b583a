"""What abusers cost a neighbour of theirs, on a real ArduCopter."""

import pytest

from benchmarks.aps.aps_sources import RATE_HZ
from benchmarks.aps.bench_aps_fairness import ABUSES, LIMIT_GAP_MS, LIMIT_GROWTH_MB, measure

pytestmark = [pytest.mark.ardupilot, pytest.mark.slow]


@pytest.mark.parametrize("abuse", [name for name in ABUSES if name != "nobody"])
def test_a_witness_of_a_real_autopilot_loses_nothing_to_an_abuser(arducopter, abuse):
    row = measure(abuse, 3.0, "arducopter")
    assert row["growth_mb"] < LIMIT_GROWTH_MB
    assert row["messages"] > 3.5 * RATE_HZ
    assert row["gap_ms"] < max(LIMIT_GAP_MS, row["control_gap_ms"] + LIMIT_GAP_MS - 1000.0 / RATE_HZ)
