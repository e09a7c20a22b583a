"""The live view's server, without a browser: who may look, what it does to a run, what it says when it cannot start."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from bridge.bus.keys import Keys
from bridge.bus.messages import Clock, decode
from bridge.bus.session import Sample
from lostlink.view.picture.whole import UNKNOWN
from tests.integration.bridge.clients.view import View, serving
from tests.integration.bridge.conftest import STILL, Run, StartRun
from tests.unit.lostlink.replay.flown import flown, scenario_of
from tests.warm import run_lostlink

LOGGER = """\
import math
from lostlink import Agent


class Logger(Agent):
    async def fly(self):
        async for _ in self.every(0.5):
            place = {"north_m": 6.0, "east_m": 40.0}
            self.log("estimate.beacon", {**place, "covariance_m2": [100.0, 0.0, 25.0]})
            self.log("plan", {"north_m": [0.0, 6.0], "east_m": [0.0, 30.0]})
            self.log("estimate.nowhere", {**place, "covariance_m2": [math.nan, 0.0, 25.0]})

    def on_tick(self, sim_time_ns):
        for number in range(80):
            self.log(f"flood-{number}", number)
"""
MISSION = (
    STILL.replace("{{type: still}}", '{{type: own, class: "logger.py:Logger"}}')
    + """\
  - {{id: beacon, kind: emitter, place: {{north_m: 140, east_m: 220}}, frequency_hz: 433.92e+6, power_dbm: 18}}
  - {{id: truck, kind: emitter, frequency_hz: 433.95e+6, power_dbm: 10,
     track: [{{sim_time_s: 0, east_m: 100}}, {{sim_time_s: 60, east_m: 400}}]}}
"""
)


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flown(
        tmp_path_factory.mktemp("runs") / "made", scenario_of("moon2020", ("0", "1", "gcs")), ticks=200
    )


@pytest.fixture(scope="module")
def view(record: Path) -> Iterator[View]:
    with serving(record) as served:
        yield served


def test_the_page_is_for_this_machine_alone(view: View) -> None:
    assert view.get().status == 200
    assert view.get(Host="rebound.example").status == 421
    assert view.get(Origin="http://evil.example").status == 403
    assert view.get(Sec_Fetch_Site="cross-site").status == 403
    with pytest.raises(InvalidStatus, match="403"):
        connect(f"ws://127.0.0.1:{view.port}/frames", origin="http://evil.example")  # type: ignore[arg-type]


def test_the_page_names_nothing_elsewhere(view: View) -> None:
    page = view.get()
    policy = page.getheader("content-security-policy") or ""
    assert "default-src 'self'" in policy
    assert "connect-src 'self';" in policy, "nor is a WebSocket opened to another place"
    assert not re.findall(r"(?:src|href)=[\"'](?:https?:)?//", page.body)  # type: ignore[attr-defined]


def test_frames_tell_where_everybody_is(view: View) -> None:
    with connect(f"ws://127.0.0.1:{view.port}/frames") as socket:
        snapshot = json.loads(socket.recv(timeout=20))
        assert snapshot["type"] == "snapshot"
        assert [node["id"] for node in snapshot["nodes"]] == ["0", "1", "gcs"]
        frames = [json.loads(socket.recv(timeout=20)) for _ in range(3)]
    numbers = [frame["number"] for frame in frames]
    assert numbers == list(range(numbers[0], numbers[0] + 3))
    assert len(frames[0]["position"]) == 9


@pytest.mark.slow
def test_a_run_that_was_over_before_it_was_looked_at_holds_nobody_up(record: Path) -> None:
    """As `lostlink run --view` starts it, of a run that took a second or broke off at once."""
    command = ["view", str(record), "--port", "0", "--wait"]
    ended = run_lostlink(*command, timeout=30)
    assert (ended.returncode, ended.stdout) == (0, "")
    assert "the run was over before it could be looked at" in ended.stderr


def test_a_page_may_be_late_for_long(view: View) -> None:
    """On a busy machine it answers late: what the server's transport tells it is how late it may be."""
    first = view.get("/_nicegui_ws/socket.io/?EIO=4&transport=polling")
    told = json.loads(first.body[1:].split("\x1e")[0])  # type: ignore[attr-defined]
    assert told["pingTimeout"] >= 10_000


@pytest.mark.slow
def test_beyond_this_machine_a_token_is_needed(record: Path) -> None:
    without = run_lostlink("view", str(record), "--host", "0.0.0.0")
    assert without.returncode == 2
    assert "it needs a token" in without.stderr
    token = "a-token-of-this-test"
    with serving(record, "--host", "0.0.0.0", "--token", token) as view:
        assert view.address.endswith(f"/?token={token}")
        assert view.get().status == 401
        assert view.get("/?token=another-token-altogether").status == 401
        first = view.get(f"/?token={token}")
        assert first.status == 200
        cookie = (first.getheader("set-cookie") or "").split(";")[0]
        assert view.get(Cookie=cookie).status == 200
        assert view.get(Cookie=f"lostlink_view_{view.port}=wrong").status == 401
        with connect(f"ws://127.0.0.1:{view.port}/frames", additional_headers={"Cookie": cookie}) as socket:
            assert json.loads(socket.recv(timeout=20))["type"] == "snapshot"


def test_what_cannot_be_looked_at_is_told(tmp_path: Path) -> None:
    ended = run_lostlink("view", str(tmp_path))
    assert ended.returncode == 1
    assert ended.stderr.startswith("lostlink: ")
    assert str(tmp_path) in ended.stderr
    assert "Traceback" not in ended.stderr


def test_a_record_takes_no_commands_and_says_so(record: Path) -> None:
    """Its port is in use, so that it ends."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        ended = run_lostlink("view", str(record), "--control", "--port", str(port))
    assert ended.returncode == 1
    assert ended.stderr.startswith("--control: the run is over, and nobody is there to be commanded")


def test_a_port_in_use_ends_a_run_before_it_starts(start_run: StartRun) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        run = start_run("--view", "--view-port", str(port))
        assert run.finish() == 2
    assert f"TCP port {port} (live view) is in use" in run.output.decode()
    assert "--view-port" in run.output.decode()
    assert not run.out.exists()


def address_of(run: Run) -> str:
    run.wait_for("view: http://")
    found = re.search(r"view: http://(\S+)/", run.output.decode())
    assert found
    return found.group(1)


def watch(
    address: str, is_enough: Callable[[list[dict[str, Any]]], bool] = lambda _: False
) -> list[dict[str, Any]]:
    """Look as a browser does, until that is enough, the view is gone or the run is over."""
    frames: list[dict[str, Any]] = []
    try:
        with connect(f"ws://{address}/frames", open_timeout=5) as socket:
            while True:
                frames.append(json.loads(socket.recv(timeout=30)))
                if is_enough(frames):
                    return frames
                if len(frames) > 20 and frames[-1]["time"] == frames[-20]["time"] > 0.0:
                    return frames
    except ConnectionClosed:
        return frames


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_who_ends_the_view_that_stays_does_not_interrupt_the_run(start_run: StartRun, number: int) -> None:
    run = start_run("--view", "--view-port", "0", speed="1", duration_s=6.0)
    address = address_of(run)
    run.wait_for("sim time")
    with connect(f"ws://{address}/frames", open_timeout=5):
        run.wait_for("the view stays")
        run.process.send_signal(number)
        assert run.finish() == 0, run.output.decode()
    assert run.summary["ending"] == "duration"


@pytest.mark.slow
@pytest.mark.parametrize("processes", ["one", "many"])
def test_a_run_that_is_looked_at_is_the_same_run(start_run: StartRun, processes: str) -> None:
    alone = start_run("--digest", speed="max", duration_s=10.0)
    assert alone.finish() == 0, alone.output.decode()
    options = ("--digest", "--view", "--view-port", "0", "--control")
    seen = start_run(*options, speed="2", duration_s=10.0, processes=processes)
    frames = watch(address_of(seen))
    assert seen.finish() == 0, seen.output.decode()
    assert frames[0]["time"] < 2.0, "a second of the machine's time: the run waits for its view"
    assert frames[-1]["time"] == 10.0
    assert len(frames) > 30
    assert sum("lost" in frame for frame in frames) > 5
    assert (
        seen.output.decode().split("the view stays")[0].strip().splitlines()[-1]
        == alone.output.decode().splitlines()[-1]
    )
    assert seen.summary["digest"] == alone.summary["digest"]
    assert (seen.directory / "logs" / "view.log").read_text().count("\n") == 1


def shapes_of(frames: list[dict[str, Any]]) -> dict[tuple[int, str], dict[str, Any]]:
    """The newest of each, by node and name."""
    shapes = [shape for frame in frames for shape in frame.get("shapes", [])]
    return {(shape["node"], shape["name"]): shape for shape in shapes}


@pytest.mark.slow
def test_emitters_and_what_agents_log_are_seen_while_a_run_goes_on(
    start_run: StartRun, tmp_path: Path
) -> None:
    (tmp_path / "logger.py").write_text(LOGGER)
    run = start_run("--view", "--view-port", "0", scenario=MISSION, speed="1")
    wanted = {(node, name) for node in (0, 1) for name in ("estimate.beacon", "plan")}

    def has_all(frames: list[dict[str, Any]]) -> bool:
        newest = frames[-1]
        is_placed = newest.get("emitterPlaces", [UNKNOWN])[0] != UNKNOWN
        return is_placed and newest["time"] > 5.0 and wanted <= shapes_of(frames).keys()

    frames = watch(address_of(run), has_all)
    assert frames[0]["emitters"] == ["beacon", "truck"]
    beacon, truck = frames[-1]["emitterPlaces"][:3], frames[-1]["emitterPlaces"][3:]
    assert beacon == [1400, 2200, -20]
    assert truck[1] == pytest.approx(10 * (100.0 + 5.0 * frames[-1]["time"]), abs=20)
    shapes = shapes_of(frames)
    assert set(shapes) == wanted
    assert shapes[0, "estimate.beacon"]["ellipse"] == [60, 400, 245, 122, 0]  # 2.448 times 10 m and 5 m
    assert shapes[1, "plan"]["line"] == [0, 0, 60, 300]
    run.process.send_signal(signal.SIGINT)
    assert run.finish() == 130, run.output.decode()
    assert (run.directory / "logs" / "view.log").read_text().count("\n") == 1


@pytest.mark.slow
def test_a_run_that_was_held_and_stepped_is_the_same_run(start_run: StartRun) -> None:
    alone = start_run(duration_s=15.0)
    assert alone.finish() == 0
    held = start_run(speed="2", duration_s=15.0)
    held.wait_for("sim time")
    keys = Keys(held.directory.name)
    ticks: list[Clock] = []
    started = threading.Event()
    with held.join("operator") as session:

        def on_tick(sample: Sample) -> None:
            ticks.append(decode(sample.payload.to_bytes(), Clock))
            started.set()

        session.subscribe(keys.clock, on_tick)

        def ask(verb: str, number: str = "") -> dict[str, Any]:
            (reply,) = session._inner.get(keys.clock_command(verb), payload=number.encode())
            answer: dict[str, Any] = json.loads((reply.ok or reply.err).payload.to_bytes())
            return answer

        started.wait(20.0)
        answer = ask("pause")
        assert (answer["paused"], answer["speed"]) == (True, 2.0)
        for count in (1, 3):
            before = stood_still(ticks, held)
            answer = ask("step", str(0.05 * count))
            after = stood_still(ticks, held)
            assert (answer["sim_time_s"], answer["paused"]) == (after / 1e9, True)
            assert after - before == count * 50_000_000
            assert ticks[-1].paused
            assert ask("status")["sim_time_s"] == after / 1e9
        assert ask("speed", "0")["error"].startswith("speed = 0.0: must be from 0.001")
        assert ask("speed", "max")["speed"] == "max"
        assert not ask("resume")["paused"]
    assert held.finish() == 0, held.output.decode()
    assert "is held by an operator" in held.output.decode()
    assert held.summary["digest"] == alone.summary["digest"]
    assert held.summary["may_not_repeat"] == []


def stood_still(ticks: list[Clock], run: Run) -> int:
    """Sim time once no tick has come for half a second of wall time, in which a run of this speed has twenty."""
    while True:
        count = len(ticks)
        with pytest.raises(subprocess.TimeoutExpired):
            run.process.wait(0.5)
        if ticks and len(ticks) == count:
            return ticks[-1].header.stamp.ns


@pytest.mark.slow
def test_an_observer_holds_nothing(start_run: StartRun) -> None:
    run = start_run(speed="4", duration_s=10.0)
    run.wait_for("sim time")
    with run.join("observer") as session:
        assert not list(session._inner.get(Keys(run.directory.name).clock_command("pause"), timeout=2.0))
    assert run.finish() == 0
