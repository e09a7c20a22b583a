"""A run of a study whose port somebody takes before it is bound has not failed: it flies elsewhere."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from bridge.fleet.children.environment import environment_of
from bridge.fleet.preflight.slots import FIRST_SLOT
from bridge.scenario.file import with_changes
from lostlink.reading.run import load_run
from lostlink.study.case_process import RUN_FOLDER, CasePlan, read_result
from tests.unit.lostlink.replay.flown import scenario_of

FLY = """
import sys
from pathlib import Path

from bridge.fleet.preflight import slots
from lostlink.study.case_process import fly_forked

case, port = Path(sys.argv[1]), int(sys.argv[2])
conflicts = slots.conflicts


def look(uses, held=()):
    wanted, looked = list(uses), case / "looked.txt"
    if any(use.port == port for use in wanted) and not looked.exists():
        looked.touch()
        return []
    return conflicts(wanted, held)


slots.conflicts = look
fly_forked(case)
"""


@pytest.mark.slow
def test_a_run_whose_port_is_taken_after_the_look_at_it_flies_elsewhere(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        at_port = {"ports.aps": port - 10 * FIRST_SLOT, "duration_s": 0.2, "mcap.write": False}
        scenario = with_changes(scenario_of("moon2020", ("0",)), {**at_port, "figure": False})
        CasePlan(scenario.to_yaml(), (), "all").write(tmp_path)
        command = [sys.executable, "-c", FLY, str(tmp_path), str(port)]
        subprocess.run(command, check=True, timeout=120, env=environment_of(os.environ))
    assert (tmp_path / "looked.txt").exists()
    result = read_result(tmp_path)
    assert result is not None, (tmp_path / "log.txt").read_text()
    assert (result["failure"], result["metrics"]["passed"]) == ("", True)
    assert load_run(tmp_path / RUN_FOLDER).scenario.ports.first_slot > FIRST_SLOT
