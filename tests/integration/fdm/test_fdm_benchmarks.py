"""The benchmarks that are short enough, in short."""

import json

import pytest

from benchmarks.fdm import bench_fdm_fleet, bench_fdm_placement, bench_fdm_px4


@pytest.mark.slow
def test_the_benchmark_of_placement_measures_each(free_slot, monkeypatch, capsys):
    monkeypatch.setattr(bench_fdm_placement, "find_arducopter", lambda: None)
    short = ["--rounds", "1", "--seconds", "0.2", "--ua", "1", "--coupling", "serial"]
    bench_fdm_placement.main([*short, "--instance", str(free_slot(1))])
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    (factors,) = result["cases"]["1 UA, serial"]["rounds"]
    assert factors.keys() == {"auto", "spread", "shared"}
    assert all(factor > 0.5 for factor in factors.values())


@pytest.mark.slow
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


@pytest.mark.px4
@pytest.mark.usefixtures("px4")
def test_the_benchmark_of_px4_measures_both(free_slot, capsys):
    bench_fdm_px4.main(
        ["--rounds", "1", "--seconds", "0.5", "--warm-up", "3", "--instance", str(free_slot(1))]
    )
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    (factors,) = result["rounds"]
    assert factors["responder"] > 0.2
    assert factors["physics"] > 0.2


def test_without_a_px4_its_benchmark_says_so(monkeypatch, capsys):
    monkeypatch.setattr(bench_fdm_px4, "find_px4", lambda _: None)
    bench_fdm_px4.main([])
    assert "skipped" in capsys.readouterr().out
