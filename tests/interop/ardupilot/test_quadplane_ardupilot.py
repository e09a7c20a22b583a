"""A QuadPlane: the Aerosonde with four lift motors, flown by ArduPlane as it comes with Q_ENABLE."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import jsbsim
import pytest

from fdm.model.airframe import AIRFRAMES_DIR

pytestmark = [pytest.mark.ardupilot, pytest.mark.slow, pytest.mark.timeout(400)]

AEROSONDE = AIRFRAMES_DIR / "jsbsim" / "aircraft" / "aerosonde"
MOTOR = """
    <engine file="lift_motor" name="lift {number}">
      <thruster file="lift_propeller">
        <location unit="M"> <x> {x} </x> <y> {y} </y> <z> 0.03 </z> </location>
        <orient unit="DEG"> <roll> 0 </roll> <pitch> 90 </pitch> <yaw> 0 </yaw> </orient>
        <sense> {sense} </sense>
      </thruster>
    </engine>
"""
MOTORS = ((-0.5, 0.5, 1), (0.5, -0.5, 1), (-0.5, -0.5, -1), (0.5, 0.5, -1))
"""Places aft and right, m, and senses, in ArduPilot's order of a quad X."""
LIFT_MOTOR = """<?xml version="1.0"?>
<brushless_dc_motor name="lift motor">
  <velocityconstant> 420 </velocityconstant>
  <coilresistance> 0.06 </coilresistance>
  <noloadcurrent> 0.8 </noloadcurrent>
  <maxvolts> 22.2 </maxvolts>
</brushless_dc_motor>
"""
PARAMETERS = """
  Q_ENABLE: 1
  Q_FRAME_CLASS: 1
  Q_FRAME_TYPE: 1
  Q_ASSIST_SPEED: -1
  SIM_RATE_HZ: 800
"""
AGENT = """
from lostlink import Agent


class Hops(Agent):
    async def fly(self):
        ground = await self.take_off(25.0)
        for mode in ("QHOVER", "QLOITER"):
            await self.ua.set_mode(mode)
            await self.sleep(10.0)
            self.record("hops", what=mode, value=self.ua.state.altitude_rel_m)
        await self.ua.goto(ground.latitude_deg + 0.005, ground.longitude_deg, 60.0)
        self.record("hops", what="out_mps", value=self.ua.state.airspeed_mps)
        await self.ua.rtl()
        await self.ua.land()
        self.record("hops", what="landed_m", value=self.ua.state.altitude_rel_m)
"""
SCENARIO = """
schema: 1
name: quadplane
autopilot: ardupilot
speed: max
duration_s: 400
origin: {lat_deg: 47.3977, lon_deg: 8.5456, alt_amsl_m: 488}
radio: perfect
nodes: [{id: 0, airframe: quadplane.yaml, agent: {type: own, class: "hops.py:Hops"}}]
"""


def write_airframe(directory: Path) -> None:
    """The Aerosonde's model with lift motors (the F450's propeller at 16 in), and its map with their channels."""
    folder = directory / "models" / "aircraft" / "quadplane"
    engines = folder / "Engines"
    engines.mkdir(parents=True)
    for file in (AEROSONDE / "Engines").glob("*.xml"):
        (engines / file.name).write_bytes(file.read_bytes())
    (engines / "lift_motor.xml").write_text(LIFT_MOTOR)
    propeller = Path(jsbsim.get_default_root_dir(), "engine", "DJI_9450.xml").read_text()
    assert " 9.4 " in propeller
    assert " 6.05e-05 " in propeller
    (engines / "lift_propeller.xml").write_text(
        propeller.replace(" 9.4 ", " 16 ").replace(" 6.05e-05 ", " 4.5e-4 ")
    )
    motors = "".join(MOTOR.format(number=n, x=x, y=y, sense=sense) for n, (x, y, sense) in enumerate(MOTORS))
    model = (AEROSONDE / "aerosonde.xml").read_text().replace('name="aerosonde"', 'name="quadplane"')
    (folder / "quadplane.xml").write_text(model.replace("  </propulsion>", f"{motors}  </propulsion>"))
    channels = "".join(
        f"  - {{channel: {5 + n}, property: 'fcs/throttle-cmd-norm[{1 + n}]'}}\n" for n in range(len(MOTORS))
    )
    functions = "".join(f"  SERVO{5 + n}_FUNCTION: {33 + n}\n" for n in range(len(MOTORS)))
    text = (AIRFRAMES_DIR / "aerosonde.yaml").read_text().split("# PX4's plane")[0]
    text = text.replace("model: aerosonde", "model: quadplane").replace("root: jsbsim", "root: models")
    text = text.replace("fcs/throttle-cmd-norm,", "'fcs/throttle-cmd-norm[0]',")
    text = text.replace("\nardupilot_parameters:", f"{channels}\nardupilot_parameters:")
    (directory / "quadplane.yaml").write_text(text.rstrip() + PARAMETERS + functions)


def test_a_quadplane_takes_off_and_lands_upright_and_hovers_in_modes_of_the_stick(
    arduplane: Path, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    write_airframe(tmp_path)
    (tmp_path / "hops.py").write_text(AGENT)
    (tmp_path / "scenario.yaml").write_text(SCENARIO)
    command = [sys.executable, "-m", "lostlink.cli.main", "run", str(tmp_path / "scenario.yaml"), "--json"]
    command += ["--ardupilot-dir", str(arduplane.parent), "--out", str(tmp_path / "runs"), "--no-figure"]
    command += ["--first-slot", str(free_slot(1))]
    done = subprocess.run(command, capture_output=True, text=True, timeout=380)
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert (summary["ending"], summary["warnings"]) == ("done", [])
    [run] = (tmp_path / "runs").iterdir()
    lines = (run / "agents" / "0" / "hops.jsonl").read_text().splitlines()
    logged = {row["what"]: row["value"] for row in map(json.loads, lines)}
    assert logged["QHOVER"] == pytest.approx(25.0, abs=1.5)
    assert logged["QLOITER"] == pytest.approx(25.0, abs=1.5)
    assert logged["out_mps"] > 20.0
    assert logged["landed_m"] == pytest.approx(0.0, abs=0.5)
