"""A test that is interrupted while a flight goes on waits no longer, and its report has what the flight warned of."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from lostlink.testing.flight import Flights
from tests.unit.lostlink.replay.flown import scenario_of

HASTY = """from lostlink import Agent


class Hasty(Agent):
    async def fly(self):
        self.sleep(1.0)
        await self.sleep(60.0)
"""


def test_an_event_loop_that_waits_for_a_flight_can_be_left(tmp_path: Path) -> None:
    """As where the time of a test is up, or at Ctrl-C: the fixture ends the flight, once the loop is left."""
    flights = Flights(tmp_path)
    changes = {"speed": 1.0, "mcap.write": False}
    flight = flights.start(scenario_of("moon2020", ("0",)), duration_s=5.0, changes=changes)

    async def wait_for_its_end() -> None:
        async with asyncio.timeout(0.0):
            await flight.end()

    with pytest.raises(TimeoutError):
        asyncio.run(wait_for_its_end())
    assert not flight.is_over
    flights.stop()
    assert flight.is_over
    assert list(flight.lines())[-1] == "  seed 1"


async def test_what_a_flight_warns_of_is_told_while_it_goes_on(tmp_path: Path) -> None:
    """The report of a test whose time is up is made before its flight is ended."""
    (tmp_path / "hasty.py").write_text(HASTY, encoding="utf-8")
    changes = {
        "nodes.0.agent": {"type": "own", "class": str(tmp_path / "hasty.py:Hasty")},
        "speed": 1.0,
        "mcap.write": False,
    }
    flights = Flights(tmp_path / "runs")
    flight = await flights(scenario_of("moon2020", ("0", "1")), duration_s=60.0, changes=changes)
    await flight.at(0.5)
    ending, *told = flight.lines()
    flights.stop()
    assert ending.endswith("goes on")
    assert told[0].startswith("  warning: the agent of UA 0: coroutine")
    assert any(name == "lostlink_warning" for name, _ in flight.properties())
