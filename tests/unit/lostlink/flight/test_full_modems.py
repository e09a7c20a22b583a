"""A modem that drops much of what its host gives it is warned of: no packet in the record shows it."""

from __future__ import annotations

from pathlib import Path

import pytest

from bridge.record.events import Report
from bridge.run.directory import RunDirectory
from bridge.scenario.file import read_scenario
from lostlink.flight.summary import Timing, summarise

MODEMS = Path(__file__).parents[3] / "data" / "modems.yaml"


def warnings(run: Path, **counters: int) -> list[str]:
    run.mkdir()
    report = Report(run, "router")
    report.set_counters({f"modem.near.{name}": count for name, count in counters.items()})
    report.flush()
    scenario, directory = read_scenario(str(MODEMS)), RunDirectory(run)
    directory.write(scenario, "")
    told: list[str] = summarise(scenario, directory, Timing(1.0, 1.0), "failed")["warnings"]
    return told


@pytest.mark.parametrize(
    ("counts", "words"),
    [
        (
            {"0.bytes_in": 134915, "0.dropped_bytes": 20438},
            [
                "near: the modem of node 0 dropped 20438 of the 134915 bytes that its host gave it (15.1%), as its "
                "buffer was full: ask for less, or take a faster radio"
            ],
        ),
        (
            {"gcs.bytes_out": 900, "gcs.cut_bytes": 100},
            [
                "near: the modem of node gcs dropped 100 of the 1000 bytes that came for its host (10.0%), as its "
                "buffer was full: give its line more baud"
            ],
        ),
        ({"0.bytes_in": 134915, "0.dropped_bytes": 1349, "gcs.bytes_out": 900, "gcs.cut_bytes": 9}, []),
    ],
)
def test_a_modem_whose_buffer_was_full_is_warned_of(
    tmp_path: Path, counts: dict[str, int], words: list[str]
) -> None:
    assert warnings(tmp_path / "run", **counts) == words
