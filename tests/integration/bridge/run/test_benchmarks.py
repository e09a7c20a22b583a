"""The benchmarks that are short enough, in short."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from benchmarks import (
    bench_access,
    bench_chain,
    bench_fleet,
    bench_messages,
    bench_modem,
    bench_router,
    bench_study,
)
from benchmarks.channel import bench_media
from benchmarks.record import bench_record, bench_recording, bench_replay
from tests.unit.lostlink.replay.flown import flown, scenario_of


def test_messages_are_coded_beside_rosbags(capsys: pytest.CaptureFixture[str]) -> None:
    assert bench_messages.main(["--rounds", "3", "--calls", "300", "--json"]) == 0
    rows = {row["message"]: row for row in json.loads(capsys.readouterr().out)}
    assert {"DataPackage", "AircraftState", "Truth", "Clock", "CommandEvent"} <= rows.keys()
    assert all(row["encode"] > 0 and row["decode_rosbags"] > 0 for row in rows.values())


def test_a_million_receptions_would_cost_under_20_mb(capsys: pytest.CaptureFixture[str]) -> None:
    assert bench_record.main(["--nodes", "20", "--rows", "40000", "--rounds", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["rows"] == 39_900
    assert found["append_ns"] > 0
    assert found["parquet_bytes"] < 20.0


@pytest.mark.slow
def test_access_is_measured() -> None:
    (row,) = bench_access.main(["--receivers", "2", "--packets", "100", "--rounds", "1", "--json"])["rows"]
    assert row["rules"] > 40
    assert 0 < row["ratio"] < 10
    assert row["refused_us"] > 0


@pytest.mark.slow
def test_the_router_and_agents_are_measured(capsys: pytest.CaptureFixture[str]) -> None:
    result = bench_router.main(
        ["--receivers", "3", "--nodes", "12", "--rounds", "1", "--packets", "40", "--json"]
    )
    assert json.loads(capsys.readouterr().out) == result
    (row,) = result["rows"]
    assert row["hosts us"] > 0
    assert 0 < result["fleet"]["delivered_share"] < 0.3
    assert result["agent"]["looks at none us"] > 0


def test_media_are_measured(capsys: pytest.CaptureFixture[str]) -> None:
    bench_media.main(["--nodes", "4", "--mesh-nodes", "4", "--duration", "2", "--rounds", "1"])
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert found["saturated"]["events_per_s"] > 0
    assert found["fleet"]["receptions_per_s"] > 0
    assert found["mesh"]["receptions_per_s"] > 0


@pytest.mark.slow
def test_what_a_modem_carries_and_takes_is_measured() -> None:
    found = bench_modem.main(["--duration", "2"])
    one, both = found["one end"], found["both ends"]
    assert one["up_bytes_per_s"] < 100 < 1000 < one["down_bytes_per_s"] <= 5760
    assert min(both["up_bytes_per_s"], both["down_bytes_per_s"]) > 300
    assert 0 < one["cores"] < 0.9


@pytest.mark.slow
def test_what_chains_carry_is_measured(capsys: pytest.CaptureFixture[str]) -> None:
    bench_chain.main(["--duration", "0.4"])
    shares = json.loads(capsys.readouterr().out.splitlines()[-1])["shares"]
    assert shares["tdma, one hop at a time"] == pytest.approx([1 / hops for hops in range(1, 7)], rel=0.06)
    assert shares["csma, senses all"][-1] == pytest.approx(1 / 6, rel=0.3)


def test_redecision_and_replay_are_measured(tmp_path: Path) -> None:
    run = flown(tmp_path / "run", scenario_of("moon2020", ("0", "1")), 40)
    found = bench_replay.main(["--run", str(run), "--rounds", "1", "--json"])
    assert (found["fates"], found["is_same"]) == (80, True)
    assert all(0.0 < seconds < 5.0 for seconds in found["seconds"].values())


@pytest.mark.slow
@pytest.mark.long
def test_the_speed_of_a_study_is_measured(capsys: pytest.CaptureFixture[str]) -> None:
    assert bench_study.main(["--rounds", "1", "--seeds", "1", "--duration", "3", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert list(rows)[:2] == ["as shipped", "ticks by default"]
    assert all(row["cpu_s"] > 0 and row["per_cpu"] > 0 for row in rows.values())


@pytest.mark.slow
def test_what_recording_costs_is_measured(
    capsys: pytest.CaptureFixture[str], free_slot: Callable[[int], int]
) -> None:
    common = ["--ua", "2", "--duration", "3", "--json", "--first-slot", str(free_slot(2))]
    assert bench_recording.main([*common, "--rounds", "1"]) == 0
    row = json.loads(capsys.readouterr().out)
    assert 0.1 < row["cpu"] < 2.0
    assert bench_recording.main([*common, "--size"]) == 0
    sizes = json.loads(capsys.readouterr().out)
    assert sizes["receptions"] >= 2 * 21  # at least every third of 61 ticks
    assert 0.05 < sizes["all"] < 5.0


@pytest.mark.slow
@pytest.mark.long
def test_the_speed_of_a_fleet_is_measured_beside_that_of_its_parts(
    capsys: pytest.CaptureFixture[str], free_slot: Callable[[int], int]
) -> None:
    short = ["--sizes", "1", "--modes", "one", "one+1", "--rounds", "1", "--duration", "3", "--seconds", "1"]
    assert bench_fleet.main([*short, "--first-slot", str(free_slot(1))]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert list(row) == ["ua", "alone", "one", "one+1"]
    assert row["alone"] > 0
    for mode in ("one", "one+1"):
        assert row[mode]["ratio"] == pytest.approx(row[mode]["factor"] / row["alone"], rel=0.05)
        assert row[mode]["cpu"] > 0
