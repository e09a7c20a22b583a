"""`autopilot: external`: somebody else starts the autopilots, before the run or long after."""

from __future__ import annotations

import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress

import pytest

from fdm.wire.legacy import legacy_ports
from tests.integration.bridge.conftest import STILL, Run, StartRun

HOME = ("40.1331,-105.2404,1690,0", "40.136783119,-105.2404,1690,0")
EXTERNAL = STILL.replace("radio:", "autopilot: external\nradio:").replace(
    "{{type: still}}", "{{type: hold, altitude_m: 5}}"
)
FLIGHT_S = 15
"""Sim time: until they are ready, a climb, and some seconds."""
StartAutopilots = Callable[..., list["subprocess.Popen[bytes]"]]


@pytest.fixture
def start_autopilots() -> Iterator[StartAutopilots]:
    """Start two stand-ins by hand, as somebody outside would."""
    started: list[subprocess.Popen[bytes]] = []

    def start(slot: int, first_sysid: int = 1) -> list[subprocess.Popen[bytes]]:
        for index, home in enumerate(HOME):
            command = [sys.executable, "-m", "standin", "--sysid", str(index + first_sysid), "--home", home]
            command += ["--fdm-port", str(9002 + 10 * (slot + index))]
            command += ["--mavlink-port", str(5760 + 10 * (slot + index))]
            command += ["--parameter", "FRAME_CLASS=1", "--parameter", "FRAME_TYPE=1"]
            started.append(subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
        return started

    yield start
    for process in started:
        with suppress(ProcessLookupError):
            process.kill()
        process.wait()


def assert_flew(run: Run) -> None:
    assert run.finish() == 0, run.output.decode()
    summary = run.summary
    assert (summary["ending"], summary["unfinished"]) == ("duration", [])
    assert summary["may_not_repeat"] == []
    assert all(link["sent"] == FLIGHT_S * 20 + 1 for link in summary["links"])


@pytest.mark.slow
def test_autopilots_that_run_already_are_flown_from_the_first_tick(
    start_run: StartRun, start_autopilots: StartAutopilots, free_slot: Callable[[int], int]
) -> None:
    slot = free_slot(2)
    start_autopilots(slot)
    run = start_run("--first-slot", str(slot), scenario=EXTERNAL, duration_s=FLIGHT_S)
    assert_flew(run)


@pytest.mark.slow
def test_autopilots_may_come_after_the_run(start_run: StartRun, start_autopilots: StartAutopilots) -> None:
    run = start_run(scenario=EXTERNAL, duration_s=FLIGHT_S)
    run.wait_for("waits for the autopilots")
    start_autopilots(run.slot)
    assert_flew(run)


@pytest.mark.slow
def test_autopilots_with_other_system_ids_are_told(
    start_run: StartRun, start_autopilots: StartAutopilots
) -> None:
    """Of them nothing would fly, and nothing else says why."""
    run = start_run(scenario=EXTERNAL.replace("type: hold, altitude_m: 5", "type: still"), duration_s=4.0)
    run.wait_for("waits for the autopilots")
    start_autopilots(run.slot, first_sysid=101)
    assert run.finish() == 0, run.output.decode()
    told = [
        (event["node"], event["text"]) for event in run.summary["events"] if event["kind"] == "other_system"
    ]
    text = "its autopilot calls itself system {}: nothing that it says is taken"
    assert told == [("0", text.format(101)), ("1", text.format(102))]
    assert "UA 0: " + text.format(101) in run.summary["warnings"]
    assert text.format(102) in run.output.decode()


@pytest.mark.slow
def test_external_autopilots_repeat_too(start_run: StartRun, start_autopilots: StartAutopilots) -> None:
    digests = []
    for _ in range(2):
        run = start_run(scenario=EXTERNAL, duration_s=10.0)
        for autopilot in start_autopilots(run.slot)[-2:]:
            assert autopilot.poll() is None
        assert run.finish() == 0, run.output.decode()
        digests.append(run.summary["digests"])
    assert digests[0] == digests[1]


LEGACY = """\
schema: 1
name: legacy
speed: max
autopilot: external
duration_s: {duration_s}
origin: {{lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690.0}}
radio: perfect
fdm: {{scheme: legacy}}
ports: {{zenoh: 0, first_slot: {slot}}}
nodes:
  - {{id: 0, agent: {{type: still}}}}
"""


def fly_legacy(run: Run) -> int:
    """A peer of the paper's binary scheme, which speaks no MAVLink; returns how often it was answered."""
    state_port, servo_port = legacy_ports(run.slot)
    answers = 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        peer.bind(("127.0.0.1", state_port))
        peer.settimeout(0.5)
        while run.process.poll() is None:
            peer.sendto(struct.pack("<14H", *(1100,) * 4, *(0,) * 10), ("127.0.0.1", servo_port))
            with suppress(TimeoutError):
                peer.recv(256)
                answers += 1
    return answers


@pytest.mark.slow
@pytest.mark.parametrize("processes", ["one", "many"])
def test_an_autopilot_that_dies_is_named_while_the_run_waits(
    start_run: StartRun, start_autopilots: StartAutopilots, processes: str
) -> None:
    scenario = EXTERNAL.replace("radio:", "fdm: {{stall_timeout_s: 2}}\nradio:")
    run = start_run(scenario=scenario, processes=processes, speed="1")
    run.wait_for("waits for the autopilots")
    autopilots = start_autopilots(run.slot)
    run.wait_for("UA 1 takes off")
    autopilots[1].kill()
    run.wait_for("warning: UA 1: its autopilot does not answer")
    assert b"warning: UA 0" not in run.output
    run.stop(signal.SIGINT)


@pytest.mark.slow
def test_a_legacy_peer_needs_no_mavlink(start_run: StartRun) -> None:
    run = start_run(scenario=LEGACY, duration_s=3.0)
    run.wait_for("waits for the autopilots")
    assert fly_legacy(run) >= 3 * 400
    assert run.finish() == 0, run.output.decode()
    assert run.summary["ending"] == "duration"


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.timeout(180)
def test_the_others_fly_without_one_that_does_not_come(
    start_run: StartRun, start_autopilots: StartAutopilots
) -> None:
    run = start_run(scenario=EXTERNAL, duration_s=25.0)
    run.wait_for("waits for the autopilots")
    absent = start_autopilots(run.slot)[1]
    absent.kill()
    absent.wait()
    assert run.finish(120.0) == 0, run.output.decode()
    assert run.summary["ending"] == "duration"
    assert any("UA 1 was not waited for" in reason for reason in run.summary["may_not_repeat"])
    assert b"stalled: UA 1" in run.output
