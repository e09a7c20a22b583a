"""Parameters that PX4 said it does not have."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from bridge.run.directory import RunDirectory
from bridge.scenario.file import read_scenario
from lostlink.flight.parameters import unknown_parameters

LOG = """\
ERROR [param] Parameter UXRCE_DDS_KEY not found.
  MPC_XY_CRUISE: curr: 5.0000 -> new: 3.0000
\x1b[31mERROR [param] Parameter COM_DL_LOSS_TT not found.\x1b[0m
ERROR [param] Parameter WPNAV_SPEED not found.
"""
"""As PX4 v1.16 writes it."""
FLEET = {"COM_DL_LOSS_TT": 5, "MPC_XY_CRUISE": 3, "WPNAV_SPEED": 300}
OF_UA_1 = "UA 1: its PX4 has no parameter "


@pytest.mark.parametrize(
    ("autopilots", "own", "expected"),
    [
        (("px4", "px4"), {}, [f"{OF_UA_1}COM_DL_LOSS_TT, WPNAV_SPEED; nothing was set"]),
        (("standin", "px4"), {}, [f"{OF_UA_1}COM_DL_LOSS_TT, WPNAV_SPEED; nothing was set"]),
        (("ardupilot", "px4"), {}, []),
        (("ardupilot", "px4"), {"COM_DL_LOSS_TT": 5}, [f"{OF_UA_1}COM_DL_LOSS_TT; nothing was set"]),
        (("ardupilot", "ardupilot"), {}, []),
    ],
)
def test_names_that_px4_does_not_have_are_told_unless_they_may_be_meant_for_ardupilot(
    tmp_path: Path, autopilots: tuple[str, str], own: dict[str, Any], expected: list[str]
) -> None:
    changes = {"parameters": FLEET, "nodes.1.parameters": own}
    changes |= {f"nodes.{number}.autopilot": name for number, name in enumerate(autopilots)}
    scenario = read_scenario("separation", changes)
    run = RunDirectory.create(tmp_path, "run")
    run.log_path("autopilot-1").parent.mkdir(exist_ok=True)
    run.log_path("autopilot-1").write_text(LOG)
    assert list(unknown_parameters(scenario, run)) == expected
