"""A run's directory has the radios that its scenario names by file."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from bridge.record.provenance import collect, write_provenance
from bridge.run import carried
from bridge.run.directory import SCENARIO_FILE, RunDirectory
from bridge.scenario.file import parse_scenario, read_scenario
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.named_files import named_code
from bridge.scenario.resolve.radio import radio_from, radios_of
from channel.presets import radio_to_yaml
from lostlink.reading.moved import scenario_of
from tests.unit.bridge.scenario.test_named_files import ANTENNA, GAINS

SCENARIO = """\
schema: 1
name: own
duration_s: 5
origin: {lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 420.0}
radio: {preset: here/lab.yaml, transmit_power_dbm: 17}
networks:
  mesh: there/lab.yaml
  plain: wifi-2.4
  map: {preset: moon2020, propagation: {model: gain-map, file: here/gains.csv}}
nodes:
  - {id: 0, radio: there/lab.yaml, agent: {type: still}}
  - {id: gcs, kind: ground, agent: {type: still}, sensor: {radio: here/lab.yaml}}
"""
TABLE = "snr_db,per\n0,1\n10,0\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two radios of one name: one extends another and names a map, one a table."""
    folder = tmp_path / "work"
    for name in ("here", "there"):
        (folder / name).mkdir(parents=True)
    (folder / "here" / "base.yaml").write_text(
        "preset: moon2020\npropagation: {model: gain-map, file: gains.csv}\n"
    )
    (folder / "here" / "gains.csv").write_text(GAINS)
    (folder / "here" / "lab.yaml").write_text("preset: base.yaml\nnoise: {floor_dbm: -101.5}\n")
    (folder / "there" / "lab.yaml").write_text(
        "preset: moon2020\nerror: {model: snr-table, table_file: per.csv, reference_length_bytes: 40}\n"
    )
    (folder / "there" / "per.csv").write_text(TABLE)
    (folder / "there" / "models").mkdir()
    (folder / "there" / "models" / "mine.py").write_text(ANTENNA)
    (folder / "there" / "own.yaml").write_text(
        "preset: moon2020\nantenna: {class: '../there/models/mine.py:Mine', gain_db: 2}\n"
    )
    return folder


def radios(scenario: Scenario, folder: Path) -> list[str]:
    """Of each node on each network, and of the sensor, whole; paths as seen from a folder."""
    (sensor,) = [each.sensor.radio for each in scenario.ground if each.sensor is not None]
    found = [radio for name in scenario.network_names for radio in radios_of(scenario, (), name).values()]
    texts = [radio_to_yaml(radio.config) for radio in (*found, radio_from(sensor, scenario.origin))]
    return [text.replace(f"{folder}/", "") for text in texts]


@pytest.fixture
def moved(folder: Path, tmp_path: Path) -> tuple[list[str], Path]:
    """The radios as flown, and the run's directory, elsewhere, when all else is gone."""
    scenario = parse_scenario(SCENARIO, "own.yaml", folder)
    run = tmp_path / "run"
    run.mkdir()
    RunDirectory(run).write(scenario, "")
    flown = radios(scenario, folder / "here")
    shutil.rmtree(folder)
    return flown, run.rename(tmp_path / "elsewhere")


def test_a_record_needs_no_file_of_a_radio_from_outside(moved: tuple[list[str], Path]) -> None:
    flown, run = moved
    for scenario in (RunDirectory(run).scenario, scenario_of(run), read_scenario(run / SCENARIO_FILE)):
        assert radios(scenario, run / "radios") == flown
    names = {file.name for file in (run / "radios").iterdir()}
    assert names == {"lab.yaml", "lab-2.yaml", "gains.csv"}
    assert str(run.parent) not in (run / SCENARIO_FILE).read_text()


def test_a_run_reads_the_radios_that_were_read_before_it_and_others_those_that_it_has(
    folder: Path, tmp_path: Path
) -> None:
    """As they were: a radio that was altered since is another."""
    scenario = parse_scenario(SCENARIO, "own.yaml", folder)
    RunDirectory(tmp_path).write(scenario, "")
    assert RunDirectory(tmp_path).scenario == scenario
    flown = radios(scenario_of(tmp_path), tmp_path / "radios")
    assert flown == radios(scenario, folder / "here")
    (folder / "here" / "lab.yaml").write_text("preset: disk\n")
    assert radios(scenario_of(tmp_path), tmp_path / "radios") == flown


def test_a_run_that_is_written_again_carries_them_too(moved: tuple[list[str], Path], tmp_path: Path) -> None:
    """As that of `redecide --out`; over itself, nothing is lost."""
    flown, run = moved
    again = tmp_path / "again"
    again.mkdir()
    for target in (again, run):
        RunDirectory(target).write(RunDirectory(run).scenario, "")
        assert radios(scenario_of(target), target / "radios") == flown


@pytest.mark.parametrize("many", [False, True])
def test_a_map_that_is_too_large_or_has_files_beside_stays_where_it_is(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, many: bool
) -> None:
    if many:
        for file in folder.rglob("*.csv"):
            file.with_suffix(".prj").touch()
    else:
        monkeypatch.setattr(carried, "LARGE_BYTES", 10)
    scenario = parse_scenario(SCENARIO, "own.yaml", folder)
    RunDirectory(tmp_path).write(scenario, "")
    assert not list((tmp_path / "radios").glob("*.csv"))
    assert radios(RunDirectory(tmp_path).scenario, folder) == radios(scenario, folder)


@pytest.mark.parametrize("radio", ["there/own.yaml", "{preset: there/own.yaml, antenna: {gain_db: 3}}"])
def test_a_model_of_ones_own_in_a_radio_is_found_where_it_lies(
    folder: Path, tmp_path: Path, radio: str
) -> None:
    text = SCENARIO.replace("{preset: here/lab.yaml, transmit_power_dbm: 17}", radio)
    scenario = parse_scenario(text, "own.yaml", folder)
    run = folder / "runs" / "A"
    run.mkdir(parents=True)
    RunDirectory(run).write(scenario, "")
    write_provenance(collect({}, named_code(scenario).files), run)
    flown = radios(scenario_of(run), folder)
    assert flown[1] == radios(scenario, folder)[1]
    elsewhere = folder.rename(tmp_path / "elsewhere")
    found = [each.replace("there/../there/", "there/") for each in flown]
    assert "there/models/mine.py:Mine" in found[1]
    assert radios(scenario_of(elsewhere / "runs" / "A"), elsewhere) == found
