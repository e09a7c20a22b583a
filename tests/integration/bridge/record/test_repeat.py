"""Runs repeat byte for byte: in other splits, at other speeds, under load, with slow agents and unruly clients."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import urllib.request
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
from pymavlink import mavutil
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect as open_stream

from bridge.record.tables.deliveries import DELIVERIES
from tests.integration.bridge.conftest import STILL, Run, StartRun
from tests.unit.bridge.record.runs import change_table
from tests.warm import run_lostlink

ROOT = Path(__file__).parents[4]
HOLD = STILL.replace("{{type: still}}", "{{type: hold, altitude_m: 15}}")


def table(*arguments: str) -> list[dict[str, object]]:
    """The rows that the benchmark prints."""
    command = [sys.executable, "-m", "benchmarks.repeat", "--short", "--repeats", "1", "--json", *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode in (0, 1), done.stderr
    rows: list[dict[str, object]] = json.loads(done.stdout)
    return rows


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.timeout(600)
def test_every_line_of_the_benchmark_is_identical(
    free_slot: Callable[[int], int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ARDUPILOT_HOME", raising=False)
    for row in table("--slot", str(free_slot(4))):
        assert (row["identical"], row["remarks"]) == (1, []), row


@pytest.mark.slow
def test_another_seed_gives_another_record_and_no_other_flight(start_run: StartRun) -> None:
    runs = [start_run(*more, scenario=HOLD, duration_s=8.0) for more in ((), ("--seed", "4"))]
    for run in runs:
        assert run.finish() == 0, run.output.decode()
    first, other = (run.summary["digests"] for run in runs)
    assert first["deliveries"] != other["deliveries"]
    differ = {name for name in first if first[name] != other[name]}
    assert {name for name in differ if not name.startswith("logged/")} == {
        "deliveries"
    }  # agents tell what they heard


OTHER_MACHINE = {
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX,-AVX512F",
}
"""Variables that make this machine compute as one without vector instructions."""


@pytest.mark.slow
def test_a_machine_without_vector_instructions_flies_the_same(
    start_run: StartRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    digests = []
    for variables in ({}, OTHER_MACHINE):
        for name, value in variables.items():
            monkeypatch.setenv(name, value)
        run = start_run(scenario=HOLD, duration_s=8.0)
        assert run.finish() == 0, run.output.decode()
        digests.append(run.summary["digests"])
    assert digests[0] == digests[1]


def test_digest_is_one_line_for_ci(start_run: StartRun) -> None:
    run = start_run("--digest", "--quiet", "--no-mcap", duration_s=1.0, only_stdout=True)
    assert run.finish() == 0
    assert run.output.decode().splitlines()[-1] == run.summary["digest"]
    assert len(run.summary["digest"]) == 64
    assert not (run.directory / "run.mcap").exists()


SLOW = """\
import time
from bridge.agents import Agent

class Slow(Agent):
    async def fly(self):
        await self.take_off(15.0)

    def on_tick(self, sim_time_ns):
        time.sleep(self.options["nap_s"])
        super().on_tick(sim_time_ns)
"""


@pytest.mark.slow
@pytest.mark.long
def test_a_slow_agent_makes_the_run_slow_and_not_another(start_run: StartRun, tmp_path: Path) -> None:
    (tmp_path / "slow.py").write_text(SLOW)
    runs = []
    for nap_s in (0.0, 0.02):
        own = f"{{{{type: own, class: {tmp_path}/slow.py:Slow, has_task: false, options: {{{{nap_s: {nap_s}}}}}}}}}"
        runs.append(start_run(scenario=STILL.replace("{{type: still}}", own), duration_s=10.0))
    for run in runs:
        assert run.finish() == 0, run.output.decode()
    quick, slow = (run.summary for run in runs)
    assert slow["digests"] == quick["digests"]
    assert slow["wall_duration_s"] > 200 * 0.02


def port(run: Run, ua: int) -> int:
    return 6760 + 10 * (run.slot + ua)


def flood(run: Run) -> None:
    """Garbage as fast as it is taken, until the run is over."""
    with socket.create_connection(("127.0.0.1", port(run, 1))) as client:
        client.settimeout(1.0)
        while run.process.poll() is None:
            try:
                client.sendall(b"\xfd" * 65536)
            except TimeoutError:
                continue
            except OSError:
                return


def stall(run: Run) -> None:
    """Connect, and never read."""
    with socket.create_connection(("127.0.0.1", port(run, 1))):
        run.process.wait(60.0)


def listen(run: Run) -> None:
    """Read all telemetry, say nothing."""
    client = mavutil.mavlink_connection(f"tcp:127.0.0.1:{port(run, 1)}")
    heard = 0
    while run.process.poll() is None and (client.recv_match(blocking=True, timeout=1.0) or heard == 0):
        heard += 1
    client.close()
    assert heard > 50


@pytest.mark.slow
@pytest.mark.parametrize(
    "client", [flood, *(pytest.param(client, marks=pytest.mark.long) for client in (stall, listen))]
)
def test_a_client_that_says_nothing_to_the_autopilot_changes_nothing(
    start_run: StartRun, client: Callable[[Run], None]
) -> None:
    alone = start_run(scenario=HOLD, duration_s=8.0)
    assert alone.finish() == 0, alone.output.decode()
    watched = start_run(scenario=HOLD, duration_s=8.0, speed="4")
    watched.wait_for("sim time")
    client(watched)
    assert watched.finish() == 0, watched.output.decode()
    assert watched.summary["digests"] == alone.summary["digests"]
    inputs = (watched.directory / "inputs" / "1.jsonl").read_text().splitlines()
    assert '"open"' in inputs[0]


def open_and_end_links(place: str) -> None:
    """Have the UA's MAVLink sent to a port of ours for a while."""
    with socket.socket(type=socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(10.0)
        wish = json.dumps({"address": f"udp-out:127.0.0.1:{listener.getsockname()[1]}"}).encode()
        headers = {"Content-Type": "application/json"}
        request = urllib.request.Request(f"http://{place}/links", wish, headers)
        with urllib.request.urlopen(request, timeout=5) as reply:
            number = json.load(reply)["place"]
        assert listener.recv(65536)[0] == 0xFD
        request = urllib.request.Request(f"http://{place}/links/{number}", method="DELETE")
        with urllib.request.urlopen(request, timeout=5) as reply:
            assert reply.status == 204


def look_at_everything(run: Run, listener: socket.socket) -> Counter[str]:
    """Read the UDP output, the API and its stream until the run is over; returns what was seen."""
    seen: Counter[str] = Counter()
    place = f"127.0.0.1:{8760 + 10 * (run.slot + 1)}"
    open_and_end_links(place)
    with open_stream(f"ws://{place}/stream?rate_hz=50&messages=ATTITUDE&status_hz=10") as stream:
        while run.process.poll() is None:
            try:
                seen[json.loads(stream.recv(timeout=0.05))["type"]] += 1
            except TimeoutError:
                continue
            except ConnectionClosed:
                break
            if sum(seen.values()) % 20:
                continue
            with suppress(OSError):
                for path in ("state", "status", "links", "statistics", "messages/ATTITUDE"):
                    with urllib.request.urlopen(f"http://{place}/{path}", timeout=5) as reply:
                        seen[path] += reply.status == 200
            with suppress(BlockingIOError):
                while listener.recv(65536):
                    seen["datagrams"] += 1
    return seen


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.timeout(300)
def test_tlogs_udp_outputs_and_the_api_change_nothing_however_much_they_are_used(
    start_run: StartRun, tmp_path: Path
) -> None:
    off = HOLD + "mavlink: {{tlog: false, udp_out: []}}\napi: false\n"
    silent = start_run(scenario=off, duration_s=15.0)
    assert silent.finish() == 0, silent.output.decode()
    assert not (silent.directory / "tlog").exists()
    with socket.socket(type=socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.setblocking(False)
        place = f"127.0.0.1:{listener.getsockname()[1]}"
        on = HOLD + f"mavlink: {{{{tlog: true, udp_out: [{place}]}}}}\napi: true\n"
        told = start_run(scenario=on, duration_s=15.0, speed="2")
        told.wait_for("sim time")
        seen = look_at_everything(told, listener)
        assert told.finish() == 0, told.output.decode()
    looks = {"state", "message", "status", "links", "statistics", "messages/ATTITUDE", "datagrams"}
    assert looks <= set(seen), seen
    assert next((told.directory / "tlog").glob("1-*.tlog")).stat().st_size > 1000
    assert told.summary["digests"] == silent.summary["digests"]
    reasons = [why for why in told.summary["may_not_repeat"] if "did not end in time" not in why]
    assert reasons == []  # a loaded machine may be slow to end, which is no flight of its own


@pytest.mark.slow
def test_two_runs_beside_each_other_are_compared_by_the_command(start_run: StartRun) -> None:
    runs = [start_run(duration_s=2.0, scenario=HOLD) for _ in range(2)]
    for run in runs:
        assert run.finish() == 0, run.output.decode()
    command = ["compare", *(str(run.directory) for run in runs)]
    done = run_lostlink(*command, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("identical")
    change_table(runs[1].directory, 10, DELIVERIES, fate="burst")
    done = run_lostlink(*command, timeout=60)
    assert done.returncode == 1
    assert "deliveries, fate in row 10" in done.stdout
