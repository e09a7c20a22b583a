"""`lostlink check` loads the flight models of airframes that users bring."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from fdm.model.airframe import AIRFRAMES_DIR
from lostlink.cli.flying.check import check

SCENARIO = """
schema: 1
name: mine
duration_s: 1
origin: {lat_deg: 40, lon_deg: -105, alt_amsl_m: 1600}
radio: perfect
nodes:
  - {id: 0, agent: {type: still}}
  - {id: 1, home: {north_m: 5}, airframe: own.yaml, agent: {type: still}}
  - {id: 2, home: {north_m: 9}, airframe: own.yaml, agent: {type: still}}
"""


@pytest.mark.parametrize(
    ("old", "new", "status", "says"),
    [
        ("f450", "mine", 0, ""),
        ("</propulsion>", "", 2, "lostlink: airframe f450: JSBSim model mine: In file "),
        (
            "1.4 </emptywt>",
            "1400 </emptywt>",
            2,
            "airframe f450: JSBSim model mine sank 0.9 m into the ground",
        ),
    ],
)
def test_a_model_that_does_not_load_or_stand_is_told(
    tmp_path: Path, old: str, new: str, status: int, says: str
) -> None:
    jsbsim = AIRFRAMES_DIR / "jsbsim" / "aircraft" / "f450" / "f450.xml"
    model = tmp_path / "models" / "aircraft" / "mine" / "mine.xml"
    model.parent.mkdir(parents=True)
    model.write_text(jsbsim.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    airframe = (AIRFRAMES_DIR / "f450.yaml").read_text(encoding="utf-8")
    airframe = airframe.replace("model: f450", "model: mine").replace("root: jsbsim", "root: models")
    (tmp_path / "own.yaml").write_text(airframe, encoding="utf-8")
    (tmp_path / "mine.yaml").write_text(SCENARIO, encoding="utf-8")
    done = CliRunner().invoke(check, [str(tmp_path / "mine.yaml")])
    assert done.exit_code == status, done.output
    assert says in done.output
    assert done.output.count("\n") == 1 or not says
