"""The benchmarks that are short enough, in short."""

import json

from benchmarks import bench_fdm_placement


def test_the_benchmark_of_placement_measures_each(free_slot, monkeypatch, capsys):
    monkeypatch.setattr(bench_fdm_placement, "find_arducopter", lambda: None)
    short = ["--rounds", "1", "--seconds", "0.2", "--ua", "1", "--coupling", "serial"]
    bench_fdm_placement.main([*short, "--instance", str(free_slot(1))])
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    (factors,) = result["cases"]["1 UA, serial"]["rounds"]
    assert factors.keys() == {"auto", "spread", "shared"}
    assert all(factor > 0.5 for factor in factors.values())
