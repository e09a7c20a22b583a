"""UA that flew into their radio's terrain: a fleet of them is one warning of each network."""

from __future__ import annotations

from pathlib import Path

from bridge.run.directory import RunDirectory
from lostlink.flight.under_ground import under_ground
from tests.unit.lostlink.replay.flown import flown, scenario_of

CORNER = "origin_north_m: -5000, origin_east_m: -5000, spacing_m: 10000"
HILL = f"{{model: terrain, {CORNER}, heights_m: [[80, 80], [80, 80]]}}"


def test_of_a_fleet_the_deepest_are_told_and_how_many_more(tmp_path: Path) -> None:
    """UA 0 is 30 m up and a little more, each other one 7 m higher, in a hill of 80 m."""
    nodes = [str(number) for number in range(7)]
    scenario = scenario_of(
        f"{{preset: corrected, propagation: {HILL}}}", nodes, extra="networks: {c2: perfect}\n"
    )
    run = flown(tmp_path / "run", scenario, 5)
    [told] = under_ground(scenario, RunDirectory(run))
    assert told.startswith(
        "below the terrain of the radio of network main: UA 0 by up to 50 m, first at 0 s; 1 by up "
    )
    assert "; 4 by up to " in told
    assert "; and 2 more: nothing of it stops an aircraft" in told
