"""What agents log: in the record of each run alike, and on Zenoh while it goes on."""

from __future__ import annotations

import asyncio
import inspect
import json
import math
import queue
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bridge.agents import UaClient
from bridge.bus.keys import Keys
from bridge.bus.session import Sample, Stamp
from lostlink import Run, connect_ua, fly, load_run
from tests.integration.bridge.conftest import STILL, StartRun

AGENT = """\
import math
from lostlink import Agent


class Logger(Agent):
    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.log("built", {"node": self.ua.node, "seed": self.ua.seed})

    async def fly(self):
        async for now_s in self.every(0.5):
            self.log("error_m", self.rng.normal())
            self.log("leg", {"number": int(now_s * 2), "to_m": [1.0, now_s], "why": "because", "late": now_s > 1})
            self.log("gap_m", math.nan)
            if now_s >= 1.0:
                return
"""
OWN = STILL.replace("{{type: still}}", '{{type: own, class: "logger.py:Logger"}}')


@pytest.fixture
def file(tmp_path: Path, free_slot: Callable[[int], int]) -> Path:
    (tmp_path / "logger.py").write_text(AGENT)
    file = tmp_path / "log.yaml"
    file.write_text(OWN.format(speed="max", duration_s=20.0, slot=free_slot(2)))
    return file


def test_what_agents_log_is_recorded_and_repeats(tmp_path: Path, file: Path) -> None:
    one, other = (fly(file, directory=tmp_path / "runs") for _ in range(2))
    assert (one.ending, one.ok) == ("done", True)
    assert one.summary["digests"] == other.summary["digests"]
    assert {"states", "logged/0", "logged/1"} <= one.summary["digests"].keys()
    data = one.run.agent_data
    mine = data[data.node == "1"]
    assert mine.name.tolist() == ["built", *["error_m", "leg", "gap_m"] * 3]
    assert mine.tick_ns.tolist() == [0] * 4 + [500_000_000] * 3 + [1_000_000_000] * 3
    assert mine.value.iloc[0] == {"node": "1", "seed": 3}
    legs = one.run.agent_values("leg")
    assert legs.columns.tolist() == ["sim_time_s", "tick_ns", "node", "number", "to_m", "why", "late"]
    assert legs[legs.node == "0"].to_dict("records")[2] == {
        "sim_time_s": 1.0,
        "tick_ns": 1_000_000_000,
        "node": "0",
        "number": 2,
        "to_m": [1.0, 1.0],
        "why": "because",
        "late": False,
    }
    assert one.run.agent_values("gap_m").value.isna().all()
    errors = one.run.agent_values("error_m")
    assert errors.value.nunique() == 6
    assert one.run.activities.activity.tolist() == ["is done", "is done"]
    has_states_ten_times_a_second(one.run)


CARELESS = """\
from lostlink import Agent
from {where} import what_is_told


class Logger(Agent):
    async def fly(self):
        self.log("told", {{each: text for each, text in (await what_is_told(self.ua)).items()}})
"""
TOLD = {
    "log": "log('x'): 'a\\ud83d' is no text in UTF-8: surrogates not allowed",
    "log_name": "log('a\\ud83d'): a name is a letter or digit, then up to 63 letters, digits, '_', '-' and '.'",
    "log_mapping": "log('x.a'): 'a\\ud83d' is no text in UTF-8: surrogates not allowed",
    "report": "report: 'a\\ud83d' is no text in UTF-8: surrogates not allowed",
    "report_number": "report: 5 is no text",
    "mode": "mode: mode: 'a\\ud83d' is no text in UTF-8: surrogates not allowed",
    "message": 'message: arguments: \'{"name": "a\\ud83d"}\' is no text in UTF-8: surrogates not allowed',
    "verb": "'a\\ud83d' cannot be part of a key: use up to 255 letters, digits, '_', '-' and '.'",
    "transmit": "transmit: a payload of type str; allowed is bytes or a message",
}


async def what_is_told(ua: UaClient) -> dict[str, str]:
    """What an agent is told of mistakes with texts, where it makes them."""
    bad = "a\ud83d"
    calls: dict[str, Callable[[], Any]] = {
        "log": lambda: ua.log("x", bad),
        "log_name": lambda: ua.log(bad, 1),
        "log_mapping": lambda: ua.log("x", {"a": bad}),
        "report": lambda: ua.report(bad),
        "report_number": lambda: ua.report(5),  # type: ignore[arg-type]
        "mode": lambda: ua.set_mode(bad),
        "message": lambda: ua.message(bad),
        "verb": lambda: ua.run(bad),
        "transmit": lambda: ua.transmit("team", bad),  # type: ignore[arg-type]
    }
    told = {}
    for name, call in calls.items():
        try:
            result = call()
            if inspect.isawaitable(result):
                await result
        except (TypeError, ValueError) as error:
            told[name] = str(error)
    return told


@pytest.mark.slow
def test_what_is_no_text_is_the_callers_mistake_on_board_and_beside(
    tmp_path: Path, file: Path, start_run: StartRun
) -> None:
    (tmp_path / "logger.py").write_text(CARELESS.format(where=__name__))
    flown = fly(file, directory=tmp_path / "runs")
    assert (flown.ending, flown.ok) == ("done", True)
    assert [each["value"] for each in flown.run.agent_data.to_dict("records")] == [TOLD, TOLD]
    run = start_run(duration_s=60.0, speed="1")
    run.wait_for("sim time")

    async def beside() -> dict[str, str]:
        async with connect_ua(run.directory, 1) as ua:
            return await what_is_told(ua)

    assert asyncio.run(beside()) == TOLD


def has_states_ten_times_a_second(run: Run) -> None:
    states = run.states[run.states.node == "1"]
    assert states.tick_ns.tolist() == [100_000_000 * i for i in range(11)]
    truth = run.truth[run.truth.node == "1"].iloc[-1]
    assert states["mode"].iloc[-1] == "STABILIZE"
    assert states.latitude_deg.iloc[-1] == pytest.approx(truth.latitude_deg, abs=1e-6)
    assert math.isnan(states.latitude_deg.iloc[0])
    assert not states.armed.any()


def test_what_agents_log_is_published_if_anybody_subscribes(start_run: StartRun, tmp_path: Path) -> None:
    (tmp_path / "logger.py").write_text(AGENT.replace("if now_s >= 1.0:", "if now_s >= 4.0:"))
    run = start_run(scenario=OWN, speed="2")
    run.wait_for("sim time")
    came: queue.SimpleQueue[tuple[str, int, Any]] = queue.SimpleQueue()

    def take(sample: Sample) -> None:
        stamp = Stamp.from_sample(sample)
        assert stamp is not None
        assert sample.payload is not None
        name = str(sample.key_expr).rsplit("/", 1)[1]
        came.put((name, stamp.sim_time_ns, json.loads(sample.payload.to_bytes())))

    with run.join("observer") as session:
        session.subscribe(Keys(run.directory.name).logged("1", "*"), take)
        published = [came.get(timeout=30.0) for _ in range(6)]
    assert run.finish() == 0
    data = load_run(run.directory).agent_data
    recorded = [
        (row["name"], row["tick_ns"], None if row["name"] == "gap_m" else row["value"])
        for row in data[data.node == "1"].to_dict("records")
    ]
    begin = recorded.index(published[0])
    assert recorded[begin : begin + 6] == published


COLOURFUL = """\
import logging
from lostlink import Agent


class Logger(Agent):
    async def fly(self):
        self.ua.report("\\x1b[31mred [near]\\x07")
        logging.getLogger("own").warning("\\x1b[2Jwiped")
        await self.sleep(0.5)
        if self.ua.node == "1":
            raise RuntimeError("\\x1b]0;title\\x07 is told")
"""


def test_control_characters_of_agents_reach_neither_the_terminal_nor_a_log(
    start_run: StartRun, tmp_path: Path
) -> None:
    (tmp_path / "logger.py").write_text(COLOURFUL)
    run = start_run(scenario=OWN, duration_s=5.0)
    assert run.finish() == 1
    told = run.output.decode()
    assert not {"\x1b", "\x07"} & set(told)
    for line in (r"UA 0 \x1b[31mred [near]\x07", r"RuntimeError in flight: \x1b]0;title\x07 is told"):
        assert line in told
    logs = {path.name: path.read_text() for path in (run.directory / "logs").glob("*.log")}
    assert not [name for name, text in logs.items() if {"\x1b", "\x07"} & set(text)]
    assert r"own: \x1b[2Jwiped" in logs["node-0.log"]
    assert load_run(run.directory).activities.activity.iloc[0] == "\x1b[31mred [near]\x07"


FORGETFUL = """\
from lostlink import Agent


class Logger(Agent):
    async def fly(self):
        self.ua.arm()
        await self.sleep(0.5)
"""


@pytest.mark.parametrize(
    "other",
    [
        pytest.param(("one", {"PYTHONHASHSEED": "1"}), marks=pytest.mark.long),
        pytest.param(("many", {"PYTHONWARNINGS": "ignore"}), marks=pytest.mark.slow),
    ],
    ids=["anew", "many"],
)
def test_a_forgotten_await_is_told_and_changes_nothing_of_the_record(
    start_run: StartRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, other: tuple[str, dict[str, str]]
) -> None:
    """Forked from the command, started anew, in many processes, and whatever warnings Python was asked for."""
    (tmp_path / "logger.py").write_text(FORGETFUL)
    digests = []
    for processes, environment in (("one", dict[str, str]()), other):
        with monkeypatch.context() as patched:
            for name, value in environment.items():
                patched.setenv(name, value)
            run = start_run(
                "--no-mcap",
                "--set",
                "hosts=2" if processes == "many" else "hosts=auto",
                scenario=OWN,
                processes=processes,
            )
        assert run.finish() == 0
        told = "coroutine 'Commands.arm' was never awaited: put await before it (logger.py, line 6)"
        assert run.summary["warnings"] == [f"the agent of UA {node}: {told}" for node in "01"]
        assert f"warning: the agent of UA 0: {told}" in run.output.decode()
        digests.append(run.summary["digest"])
    assert len(set(digests)) == 1
