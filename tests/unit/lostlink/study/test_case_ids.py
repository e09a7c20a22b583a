"""A run of a study is reused as long as all that it is made of is what it was."""

from __future__ import annotations

import shutil
from importlib import metadata, util
from pathlib import Path

import pytest

from lostlink.study.case_process import RESULT_FILE, CasePlan, write_whole
from lostlink.study.study import Study
from tests.unit.bridge.scenario.test_named_files import made

STUDY = "schema: 1\nname: mine\nscenario: scenario.yaml\nseeds: [1, 2]\n"
ORIGIN, ON_THE_TILE = "lat_deg: 47.4, lon_deg: 8.5", "lat_deg: 40.1331, lon_deg: -105.2404"
TERRAIN = "preset: moon2020\npropagation: {model: terrain, file: maps/hills.tif, extent_m: 100}\n"
TILE = Path(__file__).parents[3] / "data" / "ridge.tif"
needs_rasterio = pytest.mark.skipif(util.find_spec("rasterio") is None, reason="needs lostlink[terrain]")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A study of two runs, both done, of a scenario that names files of all kinds."""
    made(tmp_path)
    model = tmp_path / "jsbsim" / "aircraft" / "hexa550" / "hexa550.xml"
    model.write_text('<fdm_config><system file="../shared/motors"/></fdm_config>')
    (tmp_path / "jsbsim" / "aircraft" / "shared").mkdir()
    (tmp_path / "jsbsim" / "aircraft" / "shared" / "motors.xml").write_text("<system/>")
    (tmp_path / "study.yaml").write_text(STUDY)
    finish(tmp_path)
    return tmp_path


def finish(folder: Path) -> None:
    ours = Study(folder / "study.yaml", folder)
    for case in ours.cases:
        ours.path(case).mkdir(parents=True, exist_ok=True)
        result = {"failure": "", "measures": CasePlan("", (), "all").measures, "metrics": {}, "timing": {}}
        write_whole(ours.path(case) / RESULT_FILE, result)


def left(folder: Path) -> int:
    return len(Study(folder / "study.yaml", folder).left())


def test_an_untouched_study_is_reused(folder: Path) -> None:
    (folder / "maps" / "other.csv").write_text("nobody names it")
    assert left(folder) == 0


@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("maps/shear.nc", b"\0"),
        ("maps/gains.csv", b"0,0,1,9,0,1,-70\n"),
        ("own.yaml", b"# other\n"),
        ("jsbsim/aircraft/hexa550/hexa550.xml", b"<!-- other -->"),
        ("jsbsim/aircraft/hexa550/Engines/motor.xml", b"<!-- other -->"),
        ("jsbsim/aircraft/shared/motors.xml", b"<!-- other -->"),
        ("models/mine.py", b"# other\n"),
    ],
)
def test_another_content_of_a_file_is_another_run(folder: Path, name: str, more: bytes) -> None:
    with (folder / name).open("ab") as file:
        file.write(more)
    assert left(folder) == 2


@needs_rasterio
def test_another_terrain_is_another_run(folder: Path) -> None:
    hills = folder / "maps" / "hills.tif"
    shutil.copyfile(TILE, hills)
    (folder / "radio.yaml").write_text(TERRAIN)
    scenario = (folder / "scenario.yaml").read_text()
    (folder / "scenario.yaml").write_text(scenario.replace(ORIGIN, ON_THE_TILE))
    finish(folder)
    assert left(folder) == 0
    hills.write_bytes(hills.read_bytes() + b"\0")
    assert left(folder) == 2


def test_another_version_of_lostlink_is_another_run(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metadata, "version", lambda _package: "99.0")
    assert left(folder) == 2


@pytest.mark.parametrize("place", ["scenario.yaml", "radio.yaml"])
def test_another_schedule_of_slots_is_another_run(folder: Path, place: str) -> None:
    """Whether the scenario names it or a radio of its own does."""
    medium = "medium: {model: tdma, schedule_file: slots.yaml}"
    slots = "slots: [{nodes: 0, duration_s: 0.1}, {nodes: 1, duration_s: 0.2}]\n"
    (folder / "slots.yaml").write_text(slots)
    file = folder / place
    old, new = (
        ("radio: radio.yaml", f"radio: {{preset: radio.yaml, {medium}}}")
        if place == "scenario.yaml"
        else ("antenna:", f"{medium}\nantenna:")
    )
    file.write_text(file.read_text().replace(old, new))
    finish(folder)
    assert left(folder) == 0
    (folder / "slots.yaml").write_text(slots.replace("0.2", "0.3"))
    assert left(folder) == 2
