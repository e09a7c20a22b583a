"""One program to a node: the second is refused by name, and nothing is left behind."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from lostlink.attach.claim import AlreadyAttached, claimed


def test_the_second_on_a_node_is_told_who_is_there(tmp_path: Path) -> None:
    with claimed(tmp_path, "UA 1", "1", ["ping", "ua-0"]):
        with (
            pytest.raises(
                AlreadyAttached,
                match=rf"UA 1 has a program attached already: ping ua-0 \(process {os.getpid()}\)",
            ),
            claimed(tmp_path, "UA 1", "1", ["iperf3"]),
        ):
            pass
        with claimed(tmp_path, "node gcs", "gcs", ["iperf3"]):
            assert len(list(tmp_path.iterdir())) == 2
    assert list(tmp_path.iterdir()) == []
    with claimed(tmp_path, "UA 1", "1", ["iperf3"]):
        pass


def test_what_a_killed_one_left_is_no_hindrance(tmp_path: Path) -> None:
    (tmp_path / "attached-1.lock").write_text('{"pid": 1, "command": ["old and long " ')
    with claimed(tmp_path, "UA 1", "1", ["new"]):
        assert "old" not in (tmp_path / "attached-1.lock").read_text()


def test_it_is_free_again_after_an_error(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), claimed(tmp_path, "UA 1", "1", ["x"]):
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []
