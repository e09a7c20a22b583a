"""A file with one JSON object is there as a whole, or as it was."""

from __future__ import annotations

from pathlib import Path

import pytest

from bridge.run.directory import SUMMARY_FILE, RunDirectory
from bridge.run.json_object import read_object, write_object
from lostlink.flight.summary import write_summary
from tests.full_disk import no_file_beyond


def test_a_full_disk_leaves_what_was_there(tmp_path: Path) -> None:
    file = tmp_path / "ledger.json"
    write_object(file, {"links": [1]})
    with no_file_beyond(10), pytest.raises(OSError, match="too large"):
        write_object(file, {"links": list(range(100))})
    assert read_object(file, "damaged") == {"links": [1]}
    assert [each.name for each in tmp_path.iterdir()] == ["ledger.json"]


def test_a_run_whose_summary_found_no_room_has_none(tmp_path: Path) -> None:
    with no_file_beyond(10), pytest.raises(OSError, match="too large"):
        write_summary({"ending": "failed"}, RunDirectory(tmp_path))
    assert RunDirectory(tmp_path).summary == {}
    assert not (tmp_path / SUMMARY_FILE).exists()
