"""The benchmarks that are short enough, in short."""

import json

import pytest

from benchmarks import bench_access, bench_messages, bench_record, bench_router


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


def test_the_router_and_agents_are_measured(capsys: pytest.CaptureFixture[str]) -> None:
    result = bench_router.main(
        ["--receivers", "3", "--nodes", "12", "--rounds", "1", "--packets", "40", "--json"]
    )
    assert json.loads(capsys.readouterr().out) == result
    (row,) = result["rows"]
    assert row["hosts us"] > 0
    assert 0 < result["fleet"]["delivered_share"] < 0.3
    assert result["agent"]["looks at none us"] > 0
