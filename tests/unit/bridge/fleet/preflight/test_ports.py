"""Ports at which ground stations find modems, looked at before the start."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from bridge.fleet.course import FleetError
from bridge.fleet.preflight import ports
from bridge.fleet.preflight.slots import at_free_ports, at_own_ports
from bridge.scenario.file import parse_scenario
from bridge.scenario.model import Scenario

SCENARIO = """\
schema: 1
name: served
duration_s: 10
origin: {{lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690}}
radio: sik-433
ports: {{zenoh: 0, first_slot: {slot}}}
nodes:
  - {{id: 0, modems: {{main: {{serial: 1}}}}, agent: {{type: still}}}}
  - {{id: gcs, kind: ground, modems: {{main: {{serve: ["{kind}::{port}"]}}}}, agent: {{type: still}}}}
"""


@pytest.fixture(params=["tcpin", "udpin"])
def taken(
    request: pytest.FixtureRequest, tmp_path: Path, free_slot: Callable[[int], int]
) -> Iterator[tuple[Scenario, int]]:
    """A scenario, and the port of its ground station's modem, which somebody else has."""
    kind = socket.SOCK_STREAM if request.param == "tcpin" else socket.SOCK_DGRAM
    with socket.socket(type=kind) as other:
        other.bind(("127.0.0.1", 0))
        if kind == socket.SOCK_STREAM:
            other.listen()
        port = other.getsockname()[1]
        text = SCENARIO.format(kind=request.param, port=port, slot=free_slot(1))
        yield parse_scenario(text, "scenario", tmp_path, {}), port


def test_a_taken_port_of_a_modem_is_told_with_what_helps(taken: tuple[Scenario, int]) -> None:
    scenario, port = taken
    with pytest.raises(FleetError) as told, at_own_ports(scenario):
        pass
    [line] = [line for line in str(told.value).splitlines() if f"port {port} " in line]
    assert f"port {port} (modem of node gcs on main) is in use" in line
    assert line.endswith(
        "free it, or choose another in modems.main.serve of node gcs in the scenario (0: any)"
    )


def test_a_run_that_repeats_a_record_serves_no_modem(taken: tuple[Scenario, int]) -> None:
    with at_own_ports(taken[0], repeats=True) as placed:
        assert placed is taken[0]


@pytest.mark.parametrize("placed", [at_own_ports, at_free_ports])
def test_a_machine_without_a_loopback_is_told_as_such(
    placed: Callable[[Scenario], AbstractContextManager[Scenario]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """No port of it is in use."""
    monkeypatch.setattr(ports, "HOST", "192.0.2.1")  # of no machine (RFC 5737)
    scenario = parse_scenario(SCENARIO.format(kind="tcpin", port=0, slot=0), "scenario", tmp_path, {})
    with (
        pytest.raises(FleetError, match=r"^192\.0\.2\.1 cannot be bound .*: is the loopback up\?$"),
        placed(scenario),
    ):
        pass
