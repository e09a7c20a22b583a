"""What is written on the way to a whole file is ours, also in a directory that others write to."""

from __future__ import annotations

import fcntl
import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import BinaryIO

import pytest

from bridge.run.whole_file import _remove_left, whole_file
from bridge.scenario.mcap import McapSettings
from lostlink.export.mcap.file import McapFile


def linked(link: Path, tmp_path: Path) -> Path:
    """A file that is not for us, where a link leads to that somebody has put there."""
    precious = tmp_path / "precious"
    precious.write_text("of long work")
    link.symlink_to(precious)
    return precious


def test_a_link_in_its_place_is_not_followed(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    with whole_file(path) as partial:
        link = partial
    precious = linked(link, tmp_path)
    with whole_file(path) as partial:
        partial.write_text("1,2")
    assert (path.read_text(), precious.read_text()) == ("1,2", "of long work")
    assert not path.is_symlink()


def test_nor_is_it_on_the_way_to_an_mcap_file(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with whole_file(path) as partial:
        link = partial
    precious = linked(link, tmp_path)
    with McapFile(path, McapSettings()) as file:
        file.channel("/a", "std_msgs/msg/Header", "clock")
    assert precious.read_text() == "of long work"
    assert path.read_bytes().startswith(b"\x89MCAP0")
    assert not path.is_symlink()


def write_beside(path: Path, other: Connection) -> None:
    """Write the file in another process, and be told when to end it."""
    with whole_file(path) as partial, partial.open("w") as file:
        file.write("half")
        other.send("half")
        other.recv()
        file.write(", and the other half")


def begun(write: Callable[[Path, Connection], None], path: Path) -> tuple[BaseProcess, Connection]:
    """Another process that writes, and what it says and is told through."""
    here, there = multiprocessing.Pipe()
    other = multiprocessing.get_context("fork").Process(target=write, args=(path, there))
    other.start()
    return other, here


def test_two_processes_that_write_one_file_do_not_meet(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    other, here = begun(write_beside, path)
    assert here.recv() == "half"
    with whole_file(path) as partial:
        partial.write_text("whole")
    assert path.read_text() == "whole"
    here.send("go on")
    other.join()
    assert (other.exitcode, path.read_text()) == (0, "half, and the other half")
    assert list(tmp_path.iterdir()) == [path]


def test_what_a_killed_process_has_left_is_removed_by_the_next_one(tmp_path: Path) -> None:
    """And nothing else: nobody knows what others have given a name like it."""
    path = tmp_path / "table[1].csv"
    mine = tmp_path / "table[1].csv.old.partial"
    mine.write_text("of long work")
    other, here = begun(write_beside, path)
    assert here.recv() == "half"
    other.kill()
    other.join()
    assert len(list(tmp_path.iterdir())) == 2
    with whole_file(path) as partial:
        partial.write_text("whole")
    assert sorted(tmp_path.iterdir()) == [path, mine]


def test_one_that_is_taken_for_left_before_it_is_locked_is_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the next process would take for left what is being written."""
    path, flock, taken = tmp_path / "table.csv", fcntl.flock, []

    def is_late(file: BinaryIO, how: int) -> None:
        if not taken:
            taken.append(Path(file.name))
            taken[0].unlink()
        flock(file, how)

    monkeypatch.setattr(fcntl, "flock", is_late)
    with whole_file(path) as partial:
        partial.write_text("whole")
        _remove_left(path)
        assert taken == [partial]
        assert partial.exists()
    assert path.read_text() == "whole"
    assert list(tmp_path.iterdir()) == [path]


def test_a_newer_one_of_the_same_name_is_not_taken_for_the_one_that_was_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its writer has come to an end meanwhile, and writes again."""
    path, flock = tmp_path / "table.csv", fcntl.flock
    partial = tmp_path / "table.csv.1.partial"
    partial.write_text("first")

    def is_late(file: BinaryIO, how: int) -> None:
        partial.replace(path)
        partial.write_text("second")
        flock(file, how)

    monkeypatch.setattr(fcntl, "flock", is_late)
    _remove_left(path)
    assert (path.read_text(), partial.read_text()) == ("first", "second")


def test_nor_do_two_that_write_one_mcap_file(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    other, here = begun(export_beside, path)
    assert here.recv() == "begun"
    with McapFile(path, McapSettings()) as file:
        file.channel("/a", "std_msgs/msg/Header", "clock")
    here.send("go on")
    other.join()
    assert other.exitcode == 0
    assert list(tmp_path.iterdir()) == [path]


def export_beside(path: Path, other: Connection) -> None:
    """Write an MCAP file in another process, and be told when to end it."""
    with McapFile(path, McapSettings()):
        other.send("begun")
        other.recv()
