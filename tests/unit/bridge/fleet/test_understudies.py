"""Which processes of a run are forked from its command."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.unit.bridge.fleet.children.test_forked import run

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux ends a child with its parent")
CODE = """
import psutil
from bridge.fleet.understudies import understudies_of
from bridge.scenario.file import read_scenario
for processes in ("one", "many"):
    changes = {"processes": processes}
    if processes == "many":
        changes |= {"hosts": 1, "nodes.1.agent.isolated": True}
    found = understudies_of(read_scenario("separation", changes))
    print(*found, {each.pid for each in found.values()} == {each.pid for each in psutil.Process().children()})
    for each in found.values():
        each.dismiss()
import rasterio
print(understudies_of(read_scenario("separation")))
"""


@pytest.mark.slow
def test_each_process_of_ours_is_forked_from_the_command_unless_that_has_gdal(tmp_path: Path) -> None:
    done = run(tmp_path, CODE)
    assert done.stdout.splitlines() == ["fleet True", "router physics host-0 host-of-1 True", "{}"], (
        done.stderr
    )
