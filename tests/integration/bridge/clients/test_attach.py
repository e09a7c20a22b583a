"""While a run goes on in real time: MAVLink clients, `lostlink echo` and a plain Zenoh subscriber see it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from pymavlink import mavutil

from tests.integration.bridge.conftest import STILL, Run, StartRun
from tests.warm import run_lostlink

CLIENTS = Path(__file__).parents[4] / "examples" / "clients"


@pytest.fixture
def live_run(start_run: StartRun) -> Run:
    run = start_run("--speed", "1")
    run.wait_for("sim time")
    return run


def first_lines(command: list[str], count: int) -> list[str]:
    """The first lines that a program prints; it is then ended."""
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        lines = [process.stdout.readline() for _ in range(count)]
        process.kill()
    return lines


@pytest.fixture
def mavlink_clients(live_run: Run) -> Iterator[list[mavutil.mavfile]]:
    port = 6760 + 10 * (live_run.slot + 1)
    clients = [mavutil.mavlink_connection(f"tcp:127.0.0.1:{port}", source_system=s) for s in (254, 255)]
    yield clients
    for client in clients:
        client.close()


def test_two_mavlink_clients_see_ua_1_at_once(mavlink_clients: list[mavutil.mavfile]) -> None:
    for client in mavlink_clients:
        heartbeat = client.recv_match(
            type="HEARTBEAT", condition="HEARTBEAT.type==2", blocking=True, timeout=20
        )
        assert heartbeat.get_srcSystem() == 2
        position = client.recv_match(type="GLOBAL_POSITION_INT", blocking=True, timeout=20)
        assert position.get_srcSystem() == 2
        assert position.lat / 1e7 == pytest.approx(40.1331 + 410 / 111318.845, abs=1e-5)


def test_echo_prints_decoded_deliveries_of_the_run(live_run: Run) -> None:
    echo = [
        "echo",
        "lostlink/**/node/*/rx/**",
        "--out",
        str(live_run.out),
        "--count",
        "2",
        "--json",
    ]
    done = run_lostlink(*echo, timeout=30)
    assert done.returncode == 0, done.stderr
    for line in done.stdout.splitlines():
        content = json.loads(line)
        assert content["type"] == "lostlink_msgs/msg/DataPackage"
        _, _, _, receiver, _, sender, channel = content["key"].split("/")
        assert {receiver, sender} == {"0", "1"}
        assert content["message"]["header"]["frame_id"] == sender
        assert channel == "team"


def test_plain_subscriber_of_the_readme_sees_deliveries(live_run: Run) -> None:
    script = [sys.executable, str(CLIENTS / "zenoh_subscriber.py"), live_run.endpoint]
    for line in first_lines(script, 3):
        assert line.startswith(f"lostlink/{live_run.directory.name}/node/")
        assert "/rx/" in line


@pytest.mark.parametrize(
    "command", ["echo", *(pytest.param(each, marks=pytest.mark.long) for each in ("view", "token"))]
)
def test_who_would_join_a_run_without_zenoh_is_told(command: str, start_run: StartRun) -> None:
    run = start_run("--no-zenoh", "--speed", "1")
    run.wait_for("sim time")
    words = {
        "echo": ["echo", "**", "--out", str(run.out)],
        "view": ["view", str(run.directory), "--port", "0"],
        "token": ["token", str(run.directory), "--node", "1"],
    }
    done = run_lostlink(*words[command], timeout=20)
    assert done.returncode == 1
    assert done.stderr.startswith("lostlink: the run ")
    assert "has no Zenoh beside it: fly it with --zenoh" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "processes",
    [pytest.param("one", marks=pytest.mark.slow), pytest.param("many", marks=pytest.mark.long)],
)
def test_echo_ends_with_the_run_and_prints_json(processes: str, start_run: StartRun) -> None:
    run = start_run("--zenoh", "--processes", processes, "--speed", "4", duration_s=20.0, scenario=STILL)
    run.wait_for("sim time")
    command = ["echo", "lostlink/**", "--json", "--connect", run.endpoint]
    done = run_lostlink(*command, timeout=60)
    assert done.returncode == 0, done.stderr
    kinds = {json.loads(line).get("type") for line in done.stdout.splitlines()}
    assert {"lostlink_msgs/msg/Clock", "lostlink_msgs/msg/Truths"} <= kinds
    assert run.finish() == 0


def test_echo_without_a_run_says_so(tmp_path: Path) -> None:
    done = run_lostlink("echo", "lostlink/**", "--out", str(tmp_path), timeout=30)
    assert done.returncode == 1
    assert "no run goes on" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_the_example_client_ends_with_the_run(start_run: StartRun) -> None:
    run = start_run("--speed", "2", duration_s=12.0)
    run.wait_for("sim time")
    port = 6760 + 10 * (run.slot + 1)
    client = [sys.executable, str(CLIENTS / "mavlink_client.py"), f"tcp:127.0.0.1:{port}"]
    done = subprocess.run(client, capture_output=True, text=True, timeout=60)
    assert run.finish() == 0
    assert "system 2 is there" in done.stdout
    assert done.stderr.strip() == "the run is over"
