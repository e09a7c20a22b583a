"""The benchmark of memory and start-up, in short."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable

import pytest

from benchmarks import bench_memory


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_further_ua_costs_a_part_of_an_interpreter(
    free_slot: Callable[[int], int], capsys: pytest.CaptureFixture[str]
) -> None:
    short = ["--sizes", "1", "5", "--rounds", "1", "--from-sim", "1", "--hosts", "1"]
    bench_memory.main([*short, "--slot", str(free_slot(5))])
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    one, five = result["rows"]
    assert one["processes"] == five["processes"] == 5
    assert 50.0 < one["unique_mb"] < 600.0
    assert all(0.0 < row["first_tick_s"] < 60.0 for row in (one, five))
    assert result["per_further_ua_mb"] < 20.0
