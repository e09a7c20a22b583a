"""The fixture `fleet` where a flight does not begin, or does not come to its end."""

from __future__ import annotations

import os
import signal
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from bridge.fleet.autopilots.dirs import AutopilotDirs
from bridge.scenario.model import Scenario
from lostlink.testing import flight as testing
from lostlink.testing.flight import LOOK_S, FleetFlight, Flights


@pytest.mark.slow
def test_a_port_that_is_taken_at_the_last_moment_is_why_a_flight_did_not_begin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ExitStack() as taken:

        def take(scenario: Scenario, _: AutopilotDirs) -> None:
            taken.enter_context(socket.create_server(("127.0.0.1", scenario.aps_port(scenario.ua[0]))))

        monkeypatch.setattr(testing, "preflight", take)
        with pytest.raises(
            AssertionError, match=r"before a tick of it was recorded: failed; TCP port .* is in use"
        ):
            Flights(tmp_path).fly("separation", duration_s=3.0)


def interrupt_once_it_flies(flight: FleetFlight) -> None:
    """Send the main thread the signal that is its Ctrl-C here."""
    while flight.recorded_s() < 1.0 and not flight.is_over:
        time.sleep(LOOK_S)
    os.kill(os.getpid(), signal.SIGUSR1)


def interrupted_result(flight: FleetFlight) -> None:
    """Wait for its result, and be interrupted."""
    threading.Thread(target=interrupt_once_it_flies, args=(flight,)).start()
    flight.result()


@pytest.fixture
def keyboard() -> Iterator[None]:
    """SIGUSR1 is Ctrl-C, which whoever started the tests may ignore."""
    before = signal.signal(signal.SIGUSR1, signal.default_int_handler)
    yield
    signal.signal(signal.SIGUSR1, before)


@pytest.mark.slow
@pytest.mark.usefixtures("keyboard")
def test_a_flight_whose_wait_was_interrupted_ends_with_its_whole_record(tmp_path: Path) -> None:
    flights = Flights(tmp_path)
    flight = flights.start("separation", duration_s=3600.0, changes={"nodes.*.agent": {"type": "still"}})
    with pytest.raises(KeyboardInterrupt):
        interrupted_result(flight)
    assert not flight.is_over
    flights.stop()
    assert flight.is_over
    assert flight.result().ending == "interrupted"
    left = {path.name for path in flight.path.iterdir()}
    assert {"summary.json", "ledger.json", "deliveries.parquet"} <= left
    assert not [name for name in left if name.endswith((".partial", ".lock"))]


@pytest.mark.slow
def test_a_flight_that_was_only_being_started_when_all_were_stopped_ends_too(tmp_path: Path) -> None:
    flights = Flights(tmp_path)
    flights.stop()
    assert flights.start("separation", duration_s=3600.0).is_over
