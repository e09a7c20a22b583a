"""A UA whose daemon dies ends the run: its clients would wait for ever."""

from __future__ import annotations

from pathlib import Path

from bridge.bus.messages import AgentStatus
from bridge.host.hosted_aircraft import HostedAircraft
from bridge.run.directory import RunDirectory
from bridge.scenario.file import read_scenario


class Said:
    """Outlets that keep what is reported."""

    def __init__(self) -> None:
        self.reports: list[AgentStatus] = []

    def report(self, status: AgentStatus) -> None:
        self.reports.append(status)


async def test_the_death_of_its_daemon_is_reported_as_a_failure(tmp_path: Path) -> None:
    scenario, outlets = read_scenario("separation"), Said()
    run = RunDirectory.create(tmp_path, scenario.name)
    run.write(scenario, "tcp/127.0.0.1:1")
    aircraft = HostedAircraft(run, scenario.ua[0], outlets)  # type: ignore[arg-type]
    aircraft.daemon._failed(LookupError("a defect"))
    (said,) = outlets.reports
    assert said.failed
    assert said.activity == "its aircraft bridge cannot go on: a defect"
    aircraft.close()
