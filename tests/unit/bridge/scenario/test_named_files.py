"""All files are found that a scenario names, also through others."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

import pytest

from bridge.scenario.file import SCENARIOS, read_scenario
from bridge.scenario.resolve.flight import wind_of
from bridge.scenario.resolve.named_files import Named, _laws, named_code

SITL = Path(str(SCENARIOS)).parent
SCENARIO = """\
schema: 1
name: own
duration_s: 5
origin: {lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 420.0}
radio: radio.yaml
wind: wind.yaml
nodes:
  - {id: 0, airframe: own.yaml, agent: {type: own, class: "agent.py:Own"}}
  - {id: 1, agent: {type: own, class: "os.path:join"}}
"""
ANTENNA = "from channel.antenna import Isotropic\n\nclass Mine(Isotropic): ...\n"
GAINS = """\
tx_north_m,tx_east_m,tx_height_m,rx_north_m,rx_east_m,rx_height_m,gain_db
0,0,1,5,0,1,-60
"""


def made(folder: Path) -> Path:
    (folder / "own.yaml").write_text((SITL / "airframes" / "hexa550.yaml").read_text())
    model = folder / "jsbsim" / "aircraft" / "hexa550"
    (model / "Engines").mkdir(parents=True)
    (model / "hexa550.xml").write_text("<fdm_config/>")
    (model / "Engines" / "motor.xml").write_text("<electric_engine/>")
    (folder / "agent.py").write_text("from lostlink import Agent\nclass Own(Agent): ...\n")
    (folder / "wind.yaml").write_text("map: {file: maps/shear.nc}\n")
    (folder / "maps").mkdir()
    (folder / "maps" / "shear.nc").write_bytes((SITL / "wind" / "shear.nc").read_bytes())
    (folder / "radio.yaml").write_text('preset: base.yaml\nantenna: {class: "models/mine.py:Mine"}\n')
    (folder / "models").mkdir()
    (folder / "models" / "mine.py").write_text(ANTENNA)
    (folder / "base.yaml").write_text(
        "preset: moon2020\npropagation: {model: gain-map, file: maps/gains.csv}\n"
    )
    (folder / "maps" / "gains.csv").write_text(GAINS)
    (folder / "scenario.yaml").write_text(SCENARIO)
    return folder / "scenario.yaml"


def test_files_of_a_scenario_and_those_that_they_name(tmp_path: Path) -> None:
    found = named_code(read_scenario(str(made(tmp_path)))).files
    assert [str(path.relative_to(tmp_path)) for path in found] == [
        "agent.py",
        "base.yaml",
        "jsbsim/aircraft/hexa550/Engines/motor.xml",
        "jsbsim/aircraft/hexa550/hexa550.xml",
        "maps/gains.csv",
        "maps/shear.nc",
        "models/mine.py",
        "own.yaml",
        "radio.yaml",
        "wind.yaml",
    ]


def test_files_of_a_wind_that_is_spelt_out(tmp_path: Path) -> None:
    made(tmp_path)
    file = tmp_path / "scenario.yaml"
    file.write_text(SCENARIO.replace("wind: wind.yaml", "wind: {map: {file: maps/shear.nc, outside: error}}"))
    scenario = read_scenario(str(file))
    assert tmp_path / "maps" / "shear.nc" in named_code(scenario).files
    assert wind_of(scenario).map is not None


def test_code_on_the_path_of_agents_expectations_and_models(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made(tmp_path)
    package = tmp_path / "elsewhere" / "laws_here"
    package.mkdir(parents=True)
    monkeypatch.syspath_prepend(package.parent)
    agent = "import numpy\nfrom lostlink import Agent\nclass Own(Agent): ...\n"
    texts = {"agent": agent, "judge": "def holds(run): ...\n", "antenna": ANTENNA, "other": ""}
    for name, text in texts.items():
        (package / f"{name}.py").write_text(text)
    radio = tmp_path / "radio.yaml"
    radio.write_text(radio.read_text().replace("models/mine.py", "laws_here.antenna"))
    text = SCENARIO.replace("agent.py:Own", "laws_here.agent:Own").replace("os.path:join", "agent.py:Own")
    (tmp_path / "scenario.yaml").write_text(
        f"{text}expectations: [{{type: function, function: 'laws_here.judge:holds'}}]\n"
    )
    code = named_code(read_scenario(str(tmp_path / "scenario.yaml")))
    found = {str(file.relative_to(package)) for file in code.files if file.is_relative_to(package)}
    assert found == {"agent.py", "antenna.py", "judge.py"}
    assert code.packages == {"numpy": metadata.version("numpy")}


def test_a_model_that_a_package_brings_by_name_is_code_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    about = tmp_path / "leafy_here-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: leafy-here\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[lostlink.propagation]\nleafy = leafy_here:Leafy\n")
    (tmp_path / "leafy_here.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    _laws.cache_clear()
    named = Named()
    named.in_place("leafy")
    _laws.cache_clear()
    assert named.files == {tmp_path / "leafy_here.py"}


def test_what_ships_goes_by_name() -> None:
    assert named_code(read_scenario("separation")).files == ()
