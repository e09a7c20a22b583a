"""A UA whose daemon dies ends the run: its clients would wait for ever."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bridge.bus.messages import AgentStatus
from bridge.host.hosted_aircraft import HostedAircraft
from bridge.run.directory import RunDirectory
from bridge.scenario.file import read_scenario


class Said:
    """A session that keeps what is put."""

    def __init__(self) -> None:
        self.messages: list[Any] = []

    def put(self, _key: str, message: Any, **_more: Any) -> None:
        self.messages.append(message)

    def interest(self, _key: str) -> None:
        """Nobody subscribes."""

    def serve(self, _key: str, _handler: object) -> None:
        """Nobody asks."""


async def test_the_death_of_its_daemon_is_reported_as_a_failure(tmp_path: Path) -> None:
    scenario, session = read_scenario("separation"), Said()
    run = RunDirectory.create(tmp_path, scenario.name)
    run.write(scenario, "tcp/127.0.0.1:1")
    aircraft: Any = HostedAircraft(session, run, scenario.ua[0])  # type: ignore[arg-type]
    aircraft.serve()
    aircraft.daemon._failed(LookupError("a defect"))
    (said,) = session.messages
    assert isinstance(said, AgentStatus)
    assert said.failed
    assert said.activity == "its aircraft bridge cannot go on: a defect"
    aircraft.close()
