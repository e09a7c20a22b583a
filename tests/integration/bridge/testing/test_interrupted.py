"""A test that is interrupted while it waits for a flight's end does not wait for it."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from lostlink.testing.flight import Flights
from tests.unit.lostlink.replay.flown import scenario_of


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
