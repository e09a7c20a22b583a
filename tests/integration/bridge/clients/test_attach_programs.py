"""Unmodified programs on the radios of nodes: what they send is what the medium carries, recorded and repeated."""

from __future__ import annotations

import json
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from statistics import median
from time import sleep
from typing import Any

import psutil
import pytest

from lostlink import load_run
from tests.integration.bridge.conftest import Run, StartRun
from tests.integration.lostlink.namespaces import WHY_NO_NAMESPACE
from tests.warm import Command, run_lostlink

PROGRAMS = Path(__file__).parent / "attached"
TICK_NS = 50_000_000
RATE_BPS, HEADER_BYTES, QUEUE_PACKETS = 200e3, 8, 20
SCENARIO = """\
schema: 1
name: attached
description: Two UA and a ground station that stand, on a serial radio without errors.
seed: 3
speed: {speed}
duration_s: {duration_s}
origin: {{lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690.0}}
transmit: {{every_ticks: 100000}}
radio:
  preset: perfect
  bit_rate_bps: 200.0e+3
  mtu_bytes: 1200
  medium: {{model: MEDIUM, header_bytes: 8, queue: {{packets: 20}}}}
ports: {{zenoh: 0, first_slot: {slot}}}
nodes:
  - {{id: 0, agent: {{type: still}}}}
  - {{id: 1, home: {{north_m: 100}}, agent: {{type: still}}}}
  - {{id: gcs, kind: ground, place: {{east_m: 50}}, agent: {{type: still}}}}
"""
AIRTIME = SCENARIO.replace("MEDIUM", "airtime")
TDMA = SCENARIO.replace("MEDIUM", "tdma, slot_s: 0.05, guard_s: 0.001, slots: ['0', '1']")
IDEAL = SCENARIO.replace(
    "medium: {{model: MEDIUM, header_bytes: 8, queue: {{packets: 20}}}}", "medium: {{model: ideal}}"
)


pytestmark = [
    pytest.mark.skipif(bool(WHY_NO_NAMESPACE), reason=WHY_NO_NAMESPACE),
    pytest.mark.timeout(180),
]


def needs(program: str, package: str) -> pytest.MarkDecorator:
    return pytest.mark.skipif(
        shutil.which(program) is None, reason=f"no {program} here (Debian's package {package})"
    )


Attached = Command | subprocess.Popen[str]
Attach = Callable[..., Attached]


@pytest.fixture
def attach() -> Iterator[Attach]:
    """Attach a program to a node; whatever is left of it in the end is killed."""
    started: list[Attached] = []

    def start(run: Run, node: str, *words: str) -> Attached:
        options, command = (
            (words[: words.index("--")], words[words.index("--") :])
            if "--" in words
            else ((), ("--", *words))
        )
        line = ["attach", str(run.directory), "--node", node, *options, *command]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        process = Command(*line, **pipes, text=True, start_new_session=True)
        started.append(process)
        return process

    yield start
    for process in started:
        with suppress(psutil.NoSuchProcess):
            for each in (*psutil.Process(process.pid).children(recursive=True), process):
                each.kill()
        process.communicate()


def python(name: str, *arguments: object) -> list[str]:
    """A program of this folder; it imports nothing of ours."""
    return [sys.executable, "-I", str(PROGRAMS / f"{name}.py"), *map(str, arguments)]


def first_line(process: Attached) -> str:
    assert process.stdout is not None
    line = process.stdout.readline()
    assert line, process.communicate()[1]
    return line.strip()


def ended(process: Attached, timeout_s: float = 60.0) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=timeout_s)
    return process.returncode, out, err


def live(start_run: StartRun, scenario: str, *arguments: str, duration_s: float = 120.0) -> Run:
    run = start_run("--speed", "1", *arguments, scenario=scenario, duration_s=duration_s)
    run.wait_for("sim time")
    return run


def stopped(run: Run) -> dict[str, Any]:
    """End the run as Ctrl-C does; gives its summary."""
    run.stop(signal.SIGINT)
    return run.summary


def refly(run: Run, *arguments: str) -> str:
    """Fly it again; what the command says."""
    command = ["refly", str(run.directory), "--out", str(run.out.parent / "again"), "--quiet"]
    command += ["--zenoh-port", "0", "--first-slot", str(run.slot), *arguments]
    done = run_lostlink(*command, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def assert_ticks_bound(round_trips_s: list[float]) -> None:
    """A packet waits for the next tick (0 to 50 ms), and the answer for the one after that: 50 to 100 ms.

    A machine with much else to do makes it more.
    """
    assert min(round_trips_s) > 0.9 * TICK_NS / 1e9, round_trips_s
    assert median(round_trips_s) < 5 * TICK_NS / 1e9, round_trips_s


@pytest.mark.slow
def test_a_socket_program_between_two_ua_is_recorded_and_repeated_without_it(
    start_run: StartRun, attach: Attach
) -> None:
    run = live(start_run, IDEAL)
    answers = attach(run, "1", *python("echo_server"))
    assert first_line(answers) == "listens"
    status, out, err = ended(attach(run, "0", *python("echo_client", "ua-1", 10, 2500)))
    assert status == 0, err
    assert "UA 0 is 10.42.0.1 on radio main (MTU 1200 bytes)" in err
    assert "others: ua-1 10.42.0.2, gcs 10.42.0.254" in err
    round_trips_s = [float(line.split()[-1]) for line in out.splitlines()]
    assert len(round_trips_s) == 10
    assert_ticks_bound(round_trips_s)
    summary = stopped(run)
    assert ended(answers)[0] == 128 + signal.SIGTERM
    assert summary["may_not_repeat"] == []

    recorded = load_run(run.directory)
    inputs = recorded.inputs[recorded.inputs.kind == "packet"]
    # 2500 bytes and 8 of UDP in fragments of up to 1200 - 20, in multiples of 8 (RFC 791): 1176, 1176, 156.
    lengths = [len(bytes.fromhex(text)) for text in inputs[inputs.node == "0"].hex]
    assert lengths == [1196, 1196, 176] * 10
    assert set(inputs[inputs.node == "0"].to) == {"1"}
    asked, answered = (inputs[inputs.node == node].tick_ns.to_numpy() for node in ("0", "1"))
    assert set(asked % TICK_NS) == set(answered % TICK_NS) == {0}
    # An answer's first fragment enters after the last one of what it answers; those of one datagram may be ticks apart.
    assert (answered[::3] > asked[2::3]).all()
    packets = recorded.packets[recorded.packets.channel == "ip"]
    assert len(packets) == len(inputs) == 60
    assert set(packets.fate) == {"delivered"}
    assert "identical" in refly(run)
    assert "identical" in refly(run, "--processes", "many")


LENGTH = 1000
FRAME_S = 8 * (LENGTH + 8 + 20 + HEADER_BYTES) / RATE_BPS
"""On the air, of a datagram with 8 bytes of UDP's header, 20 of IP's and 8 of the radio's (docs/reference/air.md)."""


def assert_carried(run: Run, expected_bps: float, measured_bps: float, told: str) -> None:
    """What a program measured, and what came in sim time while packets waited, is what the medium carries.

    Args:
        run: that is over.
        expected_bps: of payload.
        measured_bps: by a program, in wall time.
        told: what its `lostlink attach` said: a machine with much else to do is too slow for the run.
    """
    packets = load_run(run.directory).packets
    mine = packets[(packets.channel == "ip") & (packets.tx == "0") & (packets.rx == "1")]
    mine = mine[mine.length_bytes == LENGTH + 28]
    assert set(mine.fate) <= {"delivered", "queue_full", "run_ended"}
    came_ns = mine[mine.fate == "delivered"].arrived_ns.to_numpy()
    assert len(came_ns) > 60
    carried_bps = 8 * LENGTH * (len(came_ns) - 1) / ((came_ns[-1] - came_ns[0]) / 1e9)
    assert carried_bps == pytest.approx(expected_bps, rel=0.03)
    if "warning: the run went at " not in told:
        assert measured_bps == pytest.approx(expected_bps, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("to", ["ua-1", "10.42.0.255"])
@pytest.mark.long
def test_the_throughput_is_that_of_the_medium(to: str, start_run: StartRun, attach: Attach) -> None:
    run = live(start_run, AIRTIME)
    sinks = [attach(run, node, *python("sink")) for node in ("1", "gcs")]
    assert [first_line(sink) for sink in sinks] == ["listens"] * 2
    # 1000 bytes each 20 ms: twice what the radio carries
    status, _, err = ended(attach(run, "0", *python("flood", to, LENGTH, 8, 0.02)))
    assert status == 0, err
    _, out, told = ended(sinks[0] if to == "ua-1" else sinks[1])
    total, seconds = map(float, out.split())
    if to == "ua-1":  # nobody else gets a unicast
        sinks[1].send_signal(signal.SIGTERM)
        assert "0 received" in ended(sinks[1])[2]
    stopped(run)
    assert_carried(run, 8 * LENGTH / FRAME_S, 8 * total / seconds, told)


@pytest.mark.slow
@pytest.mark.long
def test_a_program_is_on_the_radio_that_it_is_given(start_run: StartRun, attach: Attach) -> None:
    mesh = "networks: {{mesh: {{preset: perfect, mtu_bytes: 300}}}}\nports:"
    run = live(start_run, IDEAL.replace("ports:", mesh))
    server = attach(run, "1", "--radio", "mesh", "--", *python("echo_server"))
    assert first_line(server) == "listens"
    status, _, err = ended(attach(run, "0", "--radio", "mesh", "--", *python("echo_client", "ua-1", 3, 100)))
    assert status == 0, err
    assert "UA 0 is 10.42.0.1 on radio mesh (MTU 300 bytes)" in err
    stopped(run)
    recorded = load_run(run.directory)
    assert set(recorded.packets[recorded.packets.channel == "ip"].radio) == {"mesh"}
    assert "identical" in refly(run)


@needs("ping", "iputils-ping")
@pytest.mark.slow
@pytest.mark.parametrize("processes", ["one", pytest.param("many", marks=pytest.mark.long)])
def test_ping(processes: str, start_run: StartRun, attach: Attach) -> None:
    run = live(start_run, IDEAL, "--processes", processes)
    there = attach(run, "gcs", *python("echo_server"))
    assert first_line(there) == "listens"
    status, out, err = ended(attach(run, "0", "ping", "-c", "8", "-i", "0.3", "-s", "100", "gcs"))
    assert status == 0, err
    assert "8 packets transmitted, 8 received, 0% packet loss" in out
    assert_ticks_bound(
        [float(line.split("time=")[1].split()[0]) / 1e3 for line in out.splitlines() if "time=" in line]
    )
    # Nobody is attached to UA 1: its radio hears, and nothing answers.
    status, out, _ = ended(attach(run, "0", "ping", "-c", "2", "-i", "0.3", "-W", "1", "ua-1"))
    assert status == 1
    assert "2 packets transmitted, 0 received" in out
    stopped(run)
    assert "identical" in refly(run)


def wait_until_iperf_listens(server: Attached) -> None:
    """Wait until it takes connections: with ``--json`` it says nothing before its end."""
    while server.poll() is None:
        if any(map(is_iperf_that_listens, psutil.Process(server.pid).children(recursive=True))):
            return
        sleep(0.05)
    raise AssertionError(server.communicate())


def is_iperf_that_listens(process: psutil.Process) -> bool:
    """Whether a socket of its network namespace is in state 0A, TCP_LISTEN, at iperf3's port (proc(5))."""
    try:
        if process.name() != "iperf3":
            return False
        sockets = "".join(each.read_text() for each in Path(f"/proc/{process.pid}/net").glob("tcp*"))
    except (OSError, psutil.NoSuchProcess):
        return False
    return re.search(r":1451 [0-9A-F]+:0000 0A ", sockets) is not None


def iperf(attach: Attach, run: Run, *options: str) -> tuple[dict[str, Any], str]:
    """A test of iperf3 from UA 0 to UA 1; what the server reports, and what was said."""
    server = attach(run, "1", "iperf3", "--server", "--one-off", "--json")
    wait_until_iperf_listens(server)
    status, out, err = ended(
        attach(run, "0", "iperf3", "--client", "ua-1", "--connect-timeout", "5000", *options), 120.0
    )
    assert status == 0, out + err
    status, out, err = ended(server)
    assert status == 0, out + err
    report: dict[str, Any] = json.loads(out)
    return report, err


@needs("iperf3", "iperf3")
@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "carried_bps"),
    [
        pytest.param(AIRTIME, 8 * LENGTH / FRAME_S, marks=pytest.mark.long),
        (TDMA, 8 * LENGTH / 0.1),  # a slot of 49 ms has room for one frame of 41.44 ms, each 100 ms
    ],
    ids=["airtime", "tdma"],
)
def test_iperf3_by_udp_measures_the_medium(
    scenario: str, carried_bps: float, start_run: StartRun, attach: Attach
) -> None:
    run = live(start_run, scenario)
    report, told = iperf(attach, run, "--udp", "--bitrate", "400k", "--length", str(LENGTH), "--time", "10")
    seconds = [each["sum"]["bits_per_second"] for each in report["intervals"]][2:-2]
    assert len(seconds) > 5
    stopped(run)
    assert_carried(run, carried_bps, sum(seconds) / len(seconds), told)
    assert "identical" in refly(run)


@needs("iperf3", "iperf3")
@pytest.mark.slow
@pytest.mark.long
def test_iperf3_by_tcp_gets_through_and_no_more_than_the_medium_carries(
    start_run: StartRun, attach: Attach
) -> None:
    run = live(start_run, TDMA)
    report, told = iperf(attach, run, "--set-mss", "536", "--time", "10")
    carried_bps = report["end"]["sum_received"]["bits_per_second"]
    # Frames of 536 + 40 + 8 bytes take 23.36 ms: 2 to a slot. Some are sent again.
    most_bps = 2 * 8 * 536 / 0.1
    assert (0.1 if "warning: " in told else 0.5) * most_bps < carried_bps <= 1.03 * most_bps
    stopped(run)
    assert "identical" in refly(run)


@pytest.mark.slow
@pytest.mark.long
def test_at_another_speed_it_works_with_a_warning(start_run: StartRun, attach: Attach) -> None:
    run = start_run("--speed", "4", scenario=IDEAL, duration_s=200.0)
    run.wait_for("sim time")
    server = attach(run, "1", *python("echo_server"))
    assert first_line(server) == "listens"
    status, out, err = ended(attach(run, "0", *python("echo_client", "ua-1", 5, 100)))
    assert status == 0, err
    assert "warning: the run flies at 4 times real time" in err
    assert min(float(line.split()[-1]) for line in out.splitlines()) < TICK_NS / 1e9, out
