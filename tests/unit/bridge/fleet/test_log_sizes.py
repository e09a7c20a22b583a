"""Logs that grow large are told of."""

from __future__ import annotations

import os
from pathlib import Path

from bridge.fleet.log_sizes import LARGE_BYTES, LogSizes


def test_a_large_log_is_told_of_once_and_again_when_it_is_ten_times_as_large(tmp_path: Path) -> None:
    sizes, log = LogSizes(tmp_path), tmp_path / "host-0.log"
    assert not list(sizes.told())
    told = []
    (tmp_path / "node-0.log").write_text("a line\n")
    for size in (0, LARGE_BYTES - 1, LARGE_BYTES, LARGE_BYTES + 1, 10 * LARGE_BYTES - 1, 10 * LARGE_BYTES):
        log.touch()
        os.truncate(log, size)
        told += list(sizes.told())
    assert told == [
        f"{log} has {megabytes} MB by now: all that is printed and logged there is kept"
        for megabytes in (50, 500)
    ]


def test_a_log_that_is_gone_is_nothing(tmp_path: Path) -> None:
    (tmp_path / "gone.log").symlink_to(tmp_path / "nowhere")
    (tmp_path / "here.log").touch()
    os.truncate(tmp_path / "here.log", LARGE_BYTES)
    assert len(list(LogSizes(tmp_path).told())) == 1
