"""The benchmarks that are short enough, in short."""

import json

import pytest

from benchmarks import bench_access, bench_messages


def test_messages_are_coded_quicker_than_by_rosbags(capsys: pytest.CaptureFixture[str]) -> None:
    assert bench_messages.main(["--rounds", "3", "--calls", "300", "--json"]) == 0
    rows = {row["message"]: row for row in json.loads(capsys.readouterr().out)}
    assert {"DataPackage", "AircraftState", "Truth", "Clock", "CommandEvent"} <= rows.keys()
    for name, row in rows.items():
        assert row["encode"] < row["encode_rosbags"], name


def test_access_is_measured() -> None:
    (row,) = bench_access.main(["--receivers", "2", "--packets", "100", "--rounds", "1", "--json"])["rows"]
    assert row["rules"] > 40
    assert 0 < row["ratio"] < 10
    assert row["refused_us"] > 0
