"""MAVLink of a run by UDP and as tlogs: neither changes the flight."""

from __future__ import annotations

import socket

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from bridge.scenario.file import ScenarioError, parse_scenario, read_scenario, with_changes
from tests.integration.bridge.conftest import StartRun


@pytest.mark.slow
def test_outputs_reach_whoever_listens_and_change_nothing(start_run: StartRun) -> None:
    with socket.socket(type=socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.setblocking(False)
        place = f"127.0.0.1:{listener.getsockname()[1]}"
        told = start_run("--udp-out", place, duration_s=5.0)
        assert told.finish() == 0, told.output.decode()
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        senders = set()
        while True:
            try:
                messages = parser.parse_buffer(listener.recv(65536)) or []
            except BlockingIOError:
                break
            senders |= {message.get_srcSystem() for message in messages if message.get_type() == "HEARTBEAT"}
    assert senders == {1, 2}
    summary = told.summary
    assert summary["counters"]["node-0"]["mavlink.client_totals.frames_out"] > 100
    quiet = start_run("--udp-out", "none", duration_s=5.0)
    assert quiet.finish() == 0, quiet.output.decode()
    without = quiet.summary
    assert without["digest"] == summary["digest"]
    assert "mavlink.client_totals.frames_out" not in without["counters"]["node-0"]
    logs = [next((run.directory / "tlog").glob("0-*.tlog")) for run in (told, quiet)]
    assert logs[0].read_bytes() == logs[1].read_bytes()
    log = mavutil.mavlink_connection(str(logs[0]))
    position = log.recv_match(type="GLOBAL_POSITION_INT")
    assert position.lat == pytest.approx(401_331_000, abs=10_000)
    log.close()


def test_auto_outputs_are_for_real_time_only() -> None:
    scenario = read_scenario("separation")
    first, second = with_changes(scenario, {"speed": 1.0}).ua
    real_time = with_changes(scenario, {"speed": 1.0})
    assert real_time.udp_outputs(first) == ("127.0.0.1:14550", "127.0.0.1:14540")
    assert real_time.udp_outputs(second) == ("127.0.0.1:14550", "127.0.0.1:14541")
    moved = with_changes(real_time, {"ports.first_slot": 10, "ports.gcs": 0})
    assert moved.udp_outputs(first) == ("127.0.0.1:14610",)
    for port in ("gcs", "mavsdk"):
        none = with_changes(scenario, {"speed": 1.0, f"ports.{port}": 0})
        assert len(none.udp_outputs(second)) == 1
    for speed in ("max", 2.0):
        assert with_changes(scenario, {"speed": speed}).udp_outputs(first) == ()


def test_outputs_are_checked_with_the_scenario() -> None:
    text = read_scenario("separation").to_yaml()
    with pytest.raises(ScenarioError, match=r"'udp-out:nowhere' is not udp-out:HOST:PORT"):
        parse_scenario(text.replace("udp_out: auto", "udp_out: [nowhere]"), "my.yaml")
    assert with_changes(read_scenario("separation"), {"mavlink.udp_out": []}).mavlink.udp_out == ()
