"""The fixture `fleet` where a flight does not begin."""

from __future__ import annotations

import socket
from contextlib import ExitStack
from pathlib import Path

import pytest

from bridge.fleet.autopilots.dirs import AutopilotDirs
from bridge.scenario.model import Scenario
from lostlink.testing import flight as testing
from lostlink.testing.flight import Flights


@pytest.mark.slow
def test_a_port_that_is_taken_at_the_last_moment_is_why_a_flight_did_not_begin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ExitStack() as taken:

        def take(scenario: Scenario, _: AutopilotDirs) -> None:
            taken.enter_context(socket.create_server(("127.0.0.1", scenario.aps_port(scenario.ua[0]))))

        monkeypatch.setattr(testing, "preflight", take)
        with pytest.raises(
            AssertionError, match=r"ended before its first tick: failed; TCP port .* is in use"
        ):
            Flights(tmp_path).fly("separation", duration_s=3.0)
