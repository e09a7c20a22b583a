"""Why a run ends does not depend on which agent is heard of first."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

from bridge.bus.messages import AgentStatus, Header
from bridge.fleet.course import Course, FleetError
from bridge.run.directory import RunDirectory
from bridge.scenario.file import read_scenario, with_changes

TICK_NS = 2_050_000_000


def test_of_several_agents_that_fail_the_earliest_is_named_and_at_one_tick_the_first_by_the_scenario(
    tmp_path: Path,
) -> None:
    scenario, run = with_changes(read_scenario("separation"), {"nodes.1.id": 7}), RunDirectory(tmp_path)
    later, first, second = (
        ("0", AgentStatus(Header.at(TICK_NS + 50_000_000, "0"), "later", failed=True)),
        ("0", AgentStatus(Header.at(TICK_NS, "0"), "of 0", failed=True)),
        ("7", AgentStatus(Header.at(TICK_NS, "7"), "of 7", failed=True)),
    )
    for told in permutations((first, second)):
        course = Course(scenario, run)
        for node, status in told:
            course.agent(node, status)
        assert "UA 0 failed: of 0" in str(course.end())
    for told in permutations((later, second)):
        course = Course(scenario, run)
        for node, status in told:
            course.agent(node, status)
        assert "UA 7 failed: of 7" in str(course.end())
        assert isinstance(course.end(), FleetError)
