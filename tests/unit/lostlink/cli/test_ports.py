"""`--first-slot`, as `lostlink run` and `refly` have it."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest
from click.testing import CliRunner

from bridge.bus.session import free_port
from bridge.fleet.course import FleetError
from bridge.scenario.file import with_changes
from bridge.scenario.model import Scenario
from lostlink.cli.flying.run import run
from lostlink.cli.ports import at_ports
from tests.unit.lostlink.replay.flown import scenario_of


def scenario_at(port: int) -> Scenario:
    return with_changes(
        scenario_of("moon2020", ("0",)),
        {
            "ports.aps": port,
            "ports.api": free_port(),
            "ports.zenoh": free_port(),
            "processes": "one",
            "speed": 1.0,
        },
    )


def test_auto_moves_a_run_whose_ports_are_in_use_and_says_where_to(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        scenario = scenario_at(other.getsockname()[1])
        with (
            pytest.raises(FleetError, match=r"--first-slot N \(auto: to free ports\)"),
            at_ports(scenario, 0),
        ):
            pass
        with at_ports(scenario, "auto") as placed:
            slot = placed.ports.first_slot
            port = scenario.ports.aps + 10 * slot
    assert slot > 0
    assert capsys.readouterr().err == (
        "lostlink: ports of the run are in use: "
        f"it moves to --first-slot {slot}, with MAVLink from TCP port {port} on "
        "and none sent to UDP port 14550 (--udp-out sends it); Zenoh is at any free port\n"
    )
    with at_ports(scenario, "auto") as placed:
        assert placed is scenario
    assert capsys.readouterr().err == ""


def test_a_first_slot_that_is_no_number_is_told(tmp_path: Path) -> None:
    done = CliRunner().invoke(run, ["--first-slot", "any", "--out", str(tmp_path / "runs")])
    assert done.exit_code == 2
    assert "'any' is neither a whole number nor 'auto'" in done.stderr
