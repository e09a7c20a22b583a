"""`lostlink run` as a user sees it: results and mistakes (how runs end is in test_ends.py)."""

from __future__ import annotations

import json
import socket
import subprocess
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pyarrow.parquet as pq
import pytest

from bridge.bus.keys import Keys
from bridge.bus.session import Stamp
from bridge.record.tables.deliveries import DELIVERIES
from bridge.scenario.file import SCENARIOS
from tests.integration.bridge.conftest import LOSTLINK, STILL, Run, StartRun
from tests.warm import run_lostlink


def rows_of(run: Run) -> list[dict[str, Any]]:
    return pq.read_table(run.directory / "deliveries.parquet").to_pylist()


OF_NODES = {"node-0", "node-1"}
OF_STANDINS = {"autopilots-0", "autopilot-0", "autopilot-1"}
LOGS = {
    "one": {"fleet"} | OF_NODES,
    "many": {"router", "physics", "host-0", "host-1"} | OF_STANDINS | OF_NODES,
}


@pytest.mark.parametrize("processes", ["one", pytest.param("many", marks=pytest.mark.slow)])
def test_run_leaves_a_complete_and_balanced_record(start_run: StartRun, processes: str) -> None:
    run = start_run(duration_s=10.0, figure=True, processes=processes)
    assert run.finish() == 0, run.output.decode()
    summary = run.summary
    rows = rows_of(run)
    assert tuple(rows[0]) == tuple(column.name for column in DELIVERIES.columns)
    counts = Counter((row["tx"], row["rx"], row["fate"]) for row in rows)
    for link in summary["links"]:
        assert link["sent"] == link["delivered"] + sum(link["lost"].values())
        assert link["sent"] >= 200
        assert link["delivered"] == counts[link["tx"], link["rx"], "delivered"]
        for cause, number in link["lost"].items():
            assert number == counts[link["tx"], link["rx"], cause]
        assert sorted(link["lost"]) == ["channel_erasure"]
    assert {(link["tx"], link["rx"]) for link in summary["links"]} == {("0", "1"), ("1", "0")}
    assert summary["outcome"] == "pass", summary["verdict"]
    assert summary["ending"] == "duration"
    left = {path.name for path in run.directory.iterdir()}
    assert left == {
        "deliveries.parquet",
        "ledger.json",
        "logs",
        "probability_of_delivery.png",
        "provenance.json",
        "reports",
        "run.json",
        "run.mcap",
        "states.parquet",
        "tlog",
        "scenario.yaml",
        "streams",
        "summary.json",
        "truth.parquet",
    }
    logs = {path.stem for path in (run.directory / "logs").iterdir()}
    assert logs == LOGS[processes]


def test_a_run_without_packets_has_no_figure(start_run: StartRun) -> None:
    alone = "\n".join(line for line in STILL.splitlines() if "id: 1," not in line)
    run = start_run(scenario=alone + "\n", duration_s=1.0, figure=True)
    assert run.finish() == 0, run.output.decode()
    assert run.summary["bins"] == []
    assert not (run.directory / "probability_of_delivery.png").exists()


def deliveries(run: Run) -> bytes:
    return (run.directory / "deliveries.parquet").read_bytes()


def test_same_seed_same_record_byte_for_byte_at_any_speed_and_another_seed_differs(
    start_run: StartRun,
) -> None:
    runs = [start_run(*more, duration_s=4.0) for more in ((), ("--speed", "2"), ("--seed", "4"))]
    for run in runs:
        assert run.finish() == 0, run.output.decode()
    first, slower, other = map(deliveries, runs)
    assert len(rows_of(runs[0])) == 2 * (4 * 20 + 1)
    assert slower == first
    assert other != first


@pytest.mark.slow
@pytest.mark.long
def test_default_scenario_agrees_with_the_model_as_does_the_papers_radio_over_its_flight(
    tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    more = ("--out", str(tmp_path / "runs"), "--first-slot", str(free_slot(2)), "--zenoh-port", "0", "--json")
    done = run_lostlink("run", *more, timeout=280)
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert (summary["ending"], summary["unfinished"], summary["refused"]) == ("done", [], {})
    assert (summary["radio"], summary["outcome"]) == ("hata-qpsk", "pass")
    assert summary["bins_judged"] == 0  # neighbours share their shadowing
    lost = {cause for link in summary["links"] for cause in link["lost"]}
    assert lost == {"channel_erasure"}
    for link in summary["links"]:
        assert link["sent"] == link["delivered"] + sum(link["lost"].values()) > 2000
        assert 0.5 < link["delivered"] / link["sent"] < 0.75
    (run,) = (tmp_path / "runs").iterdir()
    again = lostlink("redecide", str(run), "--radio", "moon2020", "--out", "papers", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    papers = json.loads((tmp_path / "papers" / "summary.json").read_text(encoding="utf-8"))
    assert (papers["outcome"], papers["bins_judged"] >= 60) == ("pass", True)
    assert papers["bins_within"] >= 0.95 * papers["bins_judged"]


@pytest.mark.slow
def test_bad_samples_are_refused_and_the_run_goes_on(start_run: StartRun) -> None:
    run = start_run(duration_s=15.0, processes="many")
    run.wait_for("sim time")
    keys = Keys(run.directory.name)
    stamp = Stamp(1_000_000, 0).to_bytes()
    with run.join("physics") as physics, run.join("host-0") as host:
        physics.put_bytes(keys.tick("truths"), b"garbage", must_arrive=True)
        host.put_bytes(keys.answer("0"), b"garbage", must_arrive=True)
        host.put_bytes(keys.tx("0", "team"), b"without a stamp", must_arrive=True)
        host.put_bytes(keys.tx("0", "team", to="9"), b"to nobody", attachment=stamp, must_arrive=True)
    assert run.finish() == 0, run.output.decode()
    summary = run.summary
    assert summary["refused"] == {"malformed": 2, "without_stamp": 1, "unknown_address": 1}
    assert all(set(link["lost"]) <= {"channel_erasure"} for link in summary["links"])


def test_run_that_fails_before_sim_time_begins_leaves_a_summary(start_run: StartRun, tmp_path: Path) -> None:
    binary = tmp_path / "arducopter"
    binary.write_text("#!/bin/sh\necho cannot fly today\nexit 3\n")
    binary.chmod(0o755)
    run = start_run("--json", "--autopilot", "ardupilot", "--ardupilot-dir", str(tmp_path), only_stdout=True)
    assert run.finish() == 1
    assert json.loads(run.output) == run.summary
    assert run.summary["outcome"] == "broke_off"
    assert run.summary["sim_duration_s"] == 0.0
    for text in ("autopilot-", "ended with status 3", "cannot fly today"):
        assert text in run.summary["error"]


def lostlink(
    *arguments: str, cwd: Path, env: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    if env is None:
        return run_lostlink(*arguments, cwd=cwd, timeout=60)
    command = [*LOSTLINK, *arguments]
    return subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, timeout=60)


def test_mistake_in_the_scenario_ends_with_status_2_and_its_place(tmp_path: Path) -> None:
    (tmp_path / "bad.yaml").write_text("schema: 1\nname: bad\nspeeed: max\n")
    done = lostlink("run", "bad.yaml", cwd=tmp_path)
    assert done.returncode == 2
    assert "bad.yaml:3: speeed: unknown key; did you mean speed? (allowed here: schema, name" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "runs").exists()


def test_port_in_use_is_named_with_its_owner_and_how_to_move(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        done = lostlink("run", "--processes", "many", "--zenoh-port", str(port), cwd=tmp_path)
    assert done.returncode == 2
    assert f"TCP port {port} (Zenoh router) is in use" in done.stderr
    assert f"(pid {psutil.Process().pid})" in done.stderr
    assert "--zenoh-port" in done.stderr
    assert "Traceback" not in done.stderr


def test_missing_ardupilot_says_where_it_looked_and_how_to_point_to_it(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    env = {"PATH": "/usr/bin", "ARDUPILOT_HOME": str(tmp_path / "home")}
    done = lostlink(
        "run",
        "--autopilot",
        "ardupilot",
        "--ardupilot-dir",
        "empty",
        "--first-slot",
        "auto",
        cwd=tmp_path,
        env=env,
    )
    assert done.returncode == 2
    for place in (
        "empty/arducopter",
        f"{tmp_path}/home/build/sitl/bin/arducopter",
        "on PATH",
        "--ardupilot-dir",
    ):
        assert place in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("option", "value", "says"),
    [
        ("--speed", "0.01", "from 0.1 to 1e+06"),
        ("--speed", "fast", "neither a number nor 'max'"),
        ("--duration", "-1", "greater than 0"),
        ("--seed", "-1", "greater than or equal to 0"),
    ],
)
def test_bad_option_is_status_2(tmp_path: Path, option: str, value: str, says: str) -> None:
    done = lostlink("run", option, value, cwd=tmp_path)
    assert done.returncode == 2
    assert says in done.stderr
    assert "Traceback" not in done.stderr


def test_stand_in_refuses_what_is_no_multirotor(tmp_path: Path) -> None:
    text = (SCENARIOS / "separation.yaml").read_text().replace("airframe: f450", "airframe: aerosonde", 1)
    (tmp_path / "plane.yaml").write_text(text)
    done = lostlink("run", "plane.yaml", "--first-slot", "auto", cwd=tmp_path)
    assert done.returncode == 2
    assert "UA 0: the stand-in autopilot flies multirotors only" in done.stderr


def test_a_wind_map_that_is_not_there_is_told_before_the_start(tmp_path: Path) -> None:
    (tmp_path / "air.yaml").write_text("map: {file: nothing.nc}\n")
    text = (SCENARIOS / "separation.yaml").read_text().replace("\nradio:", "\nwind: air.yaml\nradio:")
    (tmp_path / "mission.yaml").write_text(text)
    done = lostlink("run", "mission.yaml", cwd=tmp_path)
    assert done.returncode == 2
    wind = f"lostlink: {tmp_path / 'air.yaml'}: map.file: there is no file {tmp_path / 'nothing.nc'}"
    assert f"{wind} (named at mission.yaml:16: wind)" in done.stderr


def test_json_output_is_the_summary_and_nothing_else(start_run: StartRun) -> None:
    run = start_run("--json", duration_s=1.0)
    assert run.finish() == 0, run.output.decode()
    assert json.loads(run.output) == run.summary


LISTENER = """\
import asyncio
from bridge.agents import Agent

class Listener(Agent):
    async def fly(self):
        self.enough = asyncio.Event()
        await self.enough.wait()
        self.ua.report("has heard enough", done=False)

    def on_packet(self, sender, channel, payload, stamp):
        super().on_packet(sender, channel, payload, stamp)
        if stamp.seq == self.options["until_seq"]:
            heard = self.latest.get(sender)  # none from who does not know where it is
            assert heard is None or heard.header.stamp.ns == stamp.sim_time_ns
            self.enough.set()
        if stamp.seq == self.options.get("raise_at_seq"):
            raise ArithmeticError("a mistake of mine")
        if stamp.seq == self.options.get("task_raises_at_seq"):
            asyncio.create_task(self.mistake())

    async def mistake(self):
        raise ArithmeticError("a mistake in a task")
"""


@pytest.mark.parametrize(
    ("options", "status", "says"),
    [
        ("{until_seq: 60}", 0, "pass: "),
        ("{until_seq: 60, raise_at_seq: 3}", 1, "the agent of UA 1 failed: ArithmeticError"),
        (
            "{until_seq: 6000, task_raises_at_seq: 3}",
            1,
            "ArithmeticError in a task of its own: a mistake in a task",
        ),
    ],
)
def test_run_with_an_agent_of_ones_own(
    start_run: StartRun, tmp_path: Path, options: str, status: int, says: str
) -> None:
    (tmp_path / "listener.py").write_text(LISTENER)
    own = f"{{type: own, class: {tmp_path}/listener.py:Listener, options: {options}}}"
    head, _, tail = STILL.rpartition("{{type: still}}")
    run = start_run(
        scenario=head.replace("radio: moon2020", "radio: perfect")
        + own.replace("{", "{{").replace("}", "}}")
        + tail
    )
    assert run.finish() == status, run.output.decode()
    assert says in run.output.decode()
    summary = run.summary
    assert summary["sim_duration_s"] < 10.0
    if status == 0:
        assert (summary["ending"], summary["unfinished"], summary["error"]) == ("done", [], None)
    else:
        assert (summary["ending"], summary["unfinished"]) == ("failed", ["1"])
        assert says in summary["error"]
        assert summary["outcome"] == "broke_off"


def test_ua_that_never_got_up_is_told(start_run: StartRun) -> None:
    head, _, tail = STILL.rpartition("{{type: still}}")
    run = start_run(scenario=f"{head}{{{{type: hold, altitude_m: 40}}}}{tail}", duration_s=3.0)
    assert run.finish() == 0, run.output.decode()
    assert run.summary["unfinished"] == ["1"]
    assert "node 1 had not finished" in run.output.decode()
