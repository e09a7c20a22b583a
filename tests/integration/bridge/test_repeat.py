"""Runs repeat byte for byte: in other splits, at other speeds, under load, with slow agents and unruly clients."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from pymavlink import mavutil

from bridge.record.tables.schema import DELIVERIES
from tests.integration.bridge.conftest import LOSTLINK, STILL, Run, StartRun
from tests.unit.bridge.record.runs import change_table

ROOT = Path(__file__).parents[3]
HOLD = STILL.replace("{{type: still}}", "{{type: hold, altitude_m: 15}}")


def table(*arguments: str) -> list[dict[str, object]]:
    """The rows that the benchmark prints."""
    command = [sys.executable, "-m", "benchmarks.repeat", "--short", "--repeats", "1", "--json", *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode in (0, 1), done.stderr
    rows: list[dict[str, object]] = json.loads(done.stdout)
    return rows


@pytest.mark.parametrize("line", ["standin loaded", "wander"])
def test_a_line_of_the_benchmark_is_identical(line: str, free_slot: Callable[[int], int]) -> None:
    [row] = table("--only", line, "--slot", str(free_slot(4)))
    assert (row["identical"], row["remarks"]) == (1, []), row


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_every_line_of_the_benchmark_is_identical(
    free_slot: Callable[[int], int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ARDUPILOT_HOME", raising=False)
    for row in table("--slot", str(free_slot(4))):
        assert (row["identical"], row["remarks"]) == (1, []), row


def test_another_seed_gives_another_record_and_no_other_flight(start_run: StartRun) -> None:
    runs = [start_run(*more, scenario=HOLD, duration_s=8.0) for more in ((), ("--seed", "4"))]
    for run in runs:
        assert run.finish() == 0, run.output.decode()
    first, other = (run.summary["digests"] for run in runs)
    assert first["deliveries"] != other["deliveries"]
    assert {name for name in first if first[name] != other[name]} == {"deliveries"}


OTHER_MACHINE = {
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX,-AVX512F",
}
"""Variables that make this machine compute as one without vector instructions."""


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
    run = start_run("--digest", "--quiet", duration_s=1.0, only_stdout=True)
    assert run.finish() == 0
    assert run.output.decode().splitlines()[-1] == run.summary["digest"]
    assert len(run.summary["digest"]) == 64


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


@pytest.mark.parametrize("client", [flood, stall, listen])
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


def test_two_runs_beside_each_other_are_compared_by_the_command(start_run: StartRun) -> None:
    runs = [start_run(duration_s=2.0, scenario=HOLD) for _ in range(2)]
    for run in runs:
        assert run.finish() == 0, run.output.decode()
    command = [*LOSTLINK, "compare", *(str(run.directory) for run in runs)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("identical")
    change_table(runs[1].directory, 10, DELIVERIES, fate="burst")
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert "deliveries, fate in row 10" in done.stdout
