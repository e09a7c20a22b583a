"""Where PX4 is found, by the layout of its build."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from bridge.run.px4 import find_px4, px4_events_file

BUILD = "build/px4_sitl_default"


@pytest.mark.parametrize("folder", ["", BUILD])
def test_it_is_found_by_its_checkout_and_by_the_folder_of_its_build(px4_home: Path, folder: str) -> None:
    binary = px4_home / BUILD / "bin" / "px4"
    assert find_px4({"PX4_HOME": str(px4_home / folder)}) == binary
    assert find_px4({"PATH": "/nowhere"}, px4_home / folder) == binary
    assert find_px4({"PATH": str(binary.parent)}) == binary


def test_what_was_said_wins_over_the_variable_and_that_over_path(tmp_path: Path, px4_home: Path) -> None:
    copies = [shutil.copytree(px4_home, tmp_path / name) for name in ("variable", "path")]
    environment = {"PX4_HOME": str(copies[0]), "PATH": str(copies[1] / BUILD / "bin")}
    assert find_px4(environment, px4_home) == px4_home / BUILD / "bin" / "px4"
    assert find_px4(environment) == copies[0] / BUILD / "bin" / "px4"
    assert find_px4(environment | {"PX4_HOME": str(tmp_path)}) == copies[1] / BUILD / "bin" / "px4"


def test_a_program_of_that_name_without_start_scripts_is_none(px4_home: Path) -> None:
    shutil.rmtree(px4_home / BUILD / "etc" / "init.d-posix")
    assert find_px4({"PATH": str(px4_home / BUILD / "bin")}, px4_home) is None


def test_a_link_on_path_leads_to_the_build(tmp_path: Path, px4_home: Path) -> None:
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "px4").symlink_to(px4_home / BUILD / "bin" / "px4")
    assert find_px4({"PATH": str(tmp_path / "bin")}) == px4_home / BUILD / "bin" / "px4"


def test_its_build_describes_its_events_or_not(px4_home: Path) -> None:
    binary, file = px4_home / BUILD / "bin" / "px4", px4_home / BUILD / "etc/extras/all_events.json.xz"
    assert px4_events_file(binary) == file
    file.unlink()
    assert px4_events_file(binary) is None
