"""One program to a node: the second is refused by name, and nothing is left behind."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

from lostlink.attach.claim import AlreadyAttached, claimed

NET = "10.42.0.0/24"


def test_the_second_on_a_node_is_told_who_is_there(tmp_path: Path) -> None:
    with claimed(tmp_path, "UA 1", "1", ["ping", "ua-0"], NET):
        with (
            pytest.raises(
                AlreadyAttached,
                match=rf"UA 1 has a program attached already: ping ua-0 \(process {os.getpid()}\)",
            ),
            claimed(tmp_path, "UA 1", "1", ["iperf3"], NET),
        ):
            pass
        with claimed(tmp_path, "node gcs", "gcs", ["iperf3"], NET):
            assert len(list(tmp_path.iterdir())) == 2
    assert list(tmp_path.iterdir()) == []
    with claimed(tmp_path, "UA 1", "1", ["iperf3"], NET):
        pass


def test_what_a_killed_one_left_is_no_hindrance(tmp_path: Path) -> None:
    (tmp_path / "attached-1.lock").write_text('{"pid": 1, "command": ["old and long " ')
    with claimed(tmp_path, "UA 1", "1", ["new"], NET):
        assert "old" not in (tmp_path / "attached-1.lock").read_text()


def test_it_is_free_again_after_an_error(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), claimed(tmp_path, "UA 1", "1", ["x"], NET):
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


def test_programs_on_other_subnets_are_told(tmp_path: Path) -> None:
    dead = subprocess.Popen(["true"])
    dead.wait()
    left = {"pid": dead.pid, "command": ["x"], "subnet": "10.1.0.0/24"}
    (tmp_path / "attached-2.lock").write_text(json.dumps(left))
    with claimed(tmp_path, "UA 0", "0", ["a"], NET) as none:
        with claimed(tmp_path, "node gcs", "gcs", ["b"], "10.43.0.0/24") as first:
            assert (none, first) == ("", "0 (10.42.0.0/24)")
            with claimed(tmp_path, "UA 1", "1", ["c"], NET) as second:
                assert second == "gcs (10.43.0.0/24)"
        with claimed(tmp_path, "UA 1", "1", ["c"], NET) as over:
            assert over == ""
