"""What is known of a real ArduCopter: the plan that an agent uploaded, home, its messages, and why it does not arm."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from bridge.agents.frames import Frames
from fdm.model.geodesy import GeodeticPosition
from lostlink.view.picture.plan import PlanDrawing
from lostlink.view.sources.onboard import OnboardLog
from tests.integration.bridge.conftest import LOSTLINK
from tests.interop.surveyor import AGENT, SCENARIO

pytestmark = [pytest.mark.ardupilot, pytest.mark.slow, pytest.mark.timeout(400)]


def flown(scenario: str, arducopter: Path, folder: Path) -> subprocess.CompletedProcess[str]:
    """What the command says of a run with a real ArduCopter, as fast as it can, which is kept in ``out``."""
    file = folder / "scenario.yaml"
    file.write_text(scenario)
    command = [*LOSTLINK, "run", str(file), "--out", str(folder / "out"), "--no-figure", "--speed", "max"]
    command += ["--autopilot", "ardupilot", "--ardupilot-dir", str(arducopter.parent)]
    return subprocess.run(command, capture_output=True, text=True, timeout=380)


def test_the_plan_of_a_real_arducopter(
    arducopter: Path, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    (tmp_path / "surveyor.py").write_text(AGENT)
    done = flown(SCENARIO.format(speed="max", duration_s=65.0, slot=free_slot(2)), arducopter, tmp_path)
    assert done.returncode == 0, done.stderr
    (run,) = (tmp_path / "out").iterdir()
    log = OnboardLog(run, "1")
    while log.read():
        pass
    onboard = log.at(65_000_000_000)
    log.close()
    assert (onboard.current, onboard.mission_state, onboard.gps_fix) == (2, "ACTIVE", 6)
    assert {"Flight plan received", "Arming motors", "Mission: 2 WP"} <= {each.text for each in onboard.texts}
    content = PlanDrawing(Frames(GeodeticPosition(40.1331, -105.2404, 1690.0))).content(
        onboard, is_guided=False
    )
    places = {item["number"]: item["at"][:2] for item in content["items"] if not item.get("beside")}
    assert places == {2: [600, 0], 3: [600, 800], 4: [1000, 800], 5: [1000, 0]}  # dm
    assert content["home"] == pytest.approx([0, 0, 0], abs=10)
    assert [part["inside"] for part in content["fence"]] == [True, False, False, True]
    assert content["rally"][0] == pytest.approx([0, 1100, -250], abs=10)


NEVER_READY = """\
schema: 1
name: never_ready
duration_s: 62
origin: {{lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690.0}}
radio: perfect
ports: {{first_slot: {slot}}}
nodes: [{{id: 0, parameters: {{FENCE_ENABLE: 1, FENCE_TYPE: 4}}, agent: {{type: hold, altitude_m: 15}}}}]
"""


def test_why_a_real_arducopter_is_not_ready_to_arm_is_shown(
    arducopter: Path, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    done = flown(NEVER_READY.format(slot=free_slot(1)), arducopter, tmp_path)
    waits = "UA 0 still waits until the autopilot is ready to arm: PreArm: Fences enabled, but none selected"
    assert waits in done.stdout.splitlines(), done.stderr


CLIMBER = """\
from lostlink import Agent

class Climber(Agent):
    async def fly(self):
        await self.take_off(10.0)
        await self.ua.velocity(0.0, 0.0, -2.0, duration_s=20.0)
"""
FENCED = """\
schema: 1
name: fenced
duration_s: 90
origin: {{lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690.0}}
radio: perfect
ports: {{first_slot: {slot}}}
parameters: {{FENCE_ENABLE: 1, FENCE_TYPE: 1, FENCE_ALT_MAX: 20, AVOID_ENABLE: 0}}
nodes: [{{id: 0, agent: {{type: own, class: climber.py:Climber}}}}]
"""


def test_a_breach_of_a_real_arducopters_fence_is_the_reason_of_the_interruption(
    arducopter: Path, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    (tmp_path / "climber.py").write_text(CLIMBER)
    done = flown(FENCED.format(slot=free_slot(1)), arducopter, tmp_path)
    told = "UA 0 velocity: velocity interrupted: mode changed to RTL (Max Alt fence breached) (climber.py:6)"
    assert told in done.stdout.splitlines(), done.stdout + done.stderr
