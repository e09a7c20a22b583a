"""A run has the system allow it the files that it needs, or says that it does not."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

TEXT = """\
schema: 1
name: many
duration_s: 10
origin: {lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690}
radio: perfect
processes: PROCESSES
nodes: [{id: 0, count: 30, agent: {type: still}}, {id: gcs, kind: ground, agent: {type: still}}]
"""
PROGRAM = """
import sys
from pathlib import Path
from resource import RLIMIT_NOFILE, getrlimit, setrlimit
from bridge.fleet.course import FleetError
from bridge.fleet.preflight.slots import at_free_ports
from bridge.scenario.file import parse_scenario
scenario = parse_scenario(sys.argv[1], "scenario", Path.cwd(), {})
setrlimit(RLIMIT_NOFILE, (100, int(sys.argv[2])))
try:
    with at_free_ports(scenario):
        print(getrlimit(RLIMIT_NOFILE)[0])
except FleetError as error:
    print(error)
"""


def said(processes: str, most: int) -> str:
    command = [sys.executable, "-c", PROGRAM, TEXT.replace("PROCESSES", processes), str(most)]
    return subprocess.run(command, check=True, capture_output=True, text=True, cwd=Path.cwd()).stdout.strip()


@pytest.mark.parametrize(
    ("processes", "most", "told"),
    [
        ("one", 2000, "1248"),
        ("one", 400, "400"),
        (
            "one",
            300,
            "in one process the run has 306 files open, and the system allows 300: raise it (ulimit -Hn), or fly it in "
            "many processes (--processes many)",
        ),
        ("many", 300, "300"),
    ],
)
def test_what_a_run_may_have_open(processes: str, most: int, told: str) -> None:
    assert said(processes, most) == told
