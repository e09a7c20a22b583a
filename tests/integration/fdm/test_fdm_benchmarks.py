"""The benchmarks that are short enough, in short."""

import json

from benchmarks import bench_fdm_fleet, bench_fdm_placement


def test_the_benchmark_of_placement_measures_each(free_slot, monkeypatch, capsys):
    monkeypatch.setattr(bench_fdm_placement, "find_arducopter", lambda: None)
    short = ["--rounds", "1", "--seconds", "0.2", "--ua", "1", "--coupling", "serial"]
    bench_fdm_placement.main([*short, "--instance", str(free_slot(1))])
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    (factors,) = result["cases"]["1 UA, serial"]["rounds"]
    assert factors.keys() == {"auto", "spread", "shared"}
    assert all(factor > 0.5 for factor in factors.values())


def test_the_benchmark_of_fleets_measures_stand_ins_in_the_air(free_slot, capsys):
    short = [
        "--sizes",
        "2",
        "--seconds",
        "0.3",
        "--warm-up",
        "0",
        "--coupling",
        "serial",
        "--standin-processes",
        "1",
    ]
    fast = ["--autopilot", "standin", "--speed", "max", "--hover"]
    bench_fdm_fleet.main([*short, *fast, "--instance", str(free_slot(2))])
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    factor, cores = result["curves"]["standin, serial"]["2"]
    assert factor > 1.0
    assert 0.0 < cores < 1.1
