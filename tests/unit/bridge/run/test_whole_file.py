"""What is written on the way to a whole file is ours, also in a directory that others write to."""

from __future__ import annotations

from pathlib import Path

import pytest

from bridge.run.whole_file import whole_file
from bridge.scenario.mcap import McapSettings
from lostlink.export.mcap.file import McapFile


def linked(link: Path, tmp_path: Path) -> Path:
    """A file that is not for us, where a link leads to that somebody has put there."""
    precious = tmp_path / "precious"
    precious.write_text("of long work")
    link.symlink_to(precious)
    return precious


@pytest.mark.parametrize("is_shared", [False, True])
def test_a_link_in_its_place_is_not_followed(tmp_path: Path, is_shared: bool) -> None:
    path = tmp_path / "table.csv"
    with whole_file(path, is_shared=is_shared) as partial:
        link = partial
    precious = linked(link, tmp_path)
    with whole_file(path, is_shared=is_shared) as partial:
        partial.write_text("1,2")
    assert (path.read_text(), precious.read_text()) == ("1,2", "of long work")
    assert not path.is_symlink()


def test_nor_is_it_on_the_way_to_an_mcap_file(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    precious = linked(path.with_suffix(".partial"), tmp_path)
    with McapFile(path, McapSettings()) as file:
        file.channel("/a", "std_msgs/msg/Header", "clock")
    assert precious.read_text() == "of long work"
    assert path.read_bytes().startswith(b"\x89MCAP0")
    assert not path.is_symlink()
