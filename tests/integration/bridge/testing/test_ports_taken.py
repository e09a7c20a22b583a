"""A flight of a test whose port somebody takes before it is bound flies elsewhere."""

from __future__ import annotations

import socket
from collections.abc import Collection, Iterable
from pathlib import Path

import pytest

from bridge.fleet.preflight import slots
from bridge.fleet.preflight.ports import PortUse, conflicts
from bridge.fleet.preflight.slots import FIRST_SLOT
from lostlink.testing.flight import Flights
from tests.unit.lostlink.replay.flown import scenario_of

pytestmark = pytest.mark.slow


def test_a_flight_whose_port_is_taken_after_the_look_at_it_flies_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[int] = []

    def look(uses: Iterable[PortUse], held: Collection[PortUse] = ()) -> list[str]:
        wanted = list(uses)
        if not looked and any(use.port == port for use in wanted):
            looked.append(port)
            return []
        return conflicts(wanted, held)

    monkeypatch.setattr(slots, "conflicts", look)
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        changes = {"ports.aps": port - 10 * FIRST_SLOT, "mcap.write": False}
        flight = Flights(tmp_path).start(scenario_of("moon2020", ("0",)), duration_s=0.2, changes=changes)
        result = flight.result()
    assert looked
    assert result.ok, result.error
    assert [flight.path] == list(tmp_path.iterdir())
    assert result.run.scenario.ports.first_slot > FIRST_SLOT
