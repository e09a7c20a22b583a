"""An agent in its thread: what it does at a tick, and what it is told, has one order and one stamp."""

from __future__ import annotations

import asyncio
import json
import logging
import math
import re
import sys
import threading
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, cast

import pytest

from aps.vehicle.commander import argument_names
from bridge.agents.agent import Agent, rng_of
from bridge.agents.client import UaClient
from bridge.agents.commands import (
    CommandFailed,
    CommandInterrupted,
    CommandRefused,
    Commands,
    CommandTimedOut,
)
from bridge.agents.outlet import OnEvent
from bridge.agents.own import load_class
from bridge.agents.running.runner import AgentRunner
from bridge.bus.messages import (
    AgentStatus,
    AircraftState,
    CommandEvent,
    CommandGoal,
    CommunicationStatus,
    DataPackage,
    Header,
    decode,
    encode,
)
from bridge.bus.reception import Reception
from bridge.bus.session import Stamp
from bridge.scenario.agents import StillAgent
from bridge.scenario.nodes import Aircraft
from bridge.scenario.own.own_class import mistake_in
from bridge.scenario.sections import Transmit
from sitl_configs.own_code import OwnCodeError

TICK_NS = 50_000_000
AIRCRAFT = Aircraft(id=1, agent=StillAgent(type="still"))


@dataclass
class Heard:
    """An outlet that keeps what it is told."""

    sent: list[tuple[str, bytes, Stamp]] = field(default_factory=list)
    reports: list[AgentStatus] = field(default_factory=list)
    commands: list[tuple[str, OnEvent]] = field(default_factory=list)

    def transmit(
        self, to: str, channel: str, payload: bytes, encoding: str, stamp: Stamp, *_: object
    ) -> None:
        self.sent.append((channel, payload, stamp))

    def report(self, status: AgentStatus) -> None:
        self.reports.append(status)

    goals: list[CommandGoal] = field(default_factory=list)

    def command(self, verb: str, goal: CommandGoal, on_event: OnEvent) -> None:
        self.commands.append((verb, on_event))
        self.goals.append(goal)


class Flown:
    """An agent that lives tick by tick, as on a host."""

    def __init__(self, make: type[Agent], *, seed: int = 3, folder: Path | None = None) -> None:
        self.outlet, self.warnings = Heard(), list[str]()
        self._idle = threading.Event()
        ua = UaClient("1", self.outlet, seed, folder)
        self.runner = AgentRunner(
            ua,
            lambda client: make(client, AIRCRAFT, Transmit(every_ticks=1000)),
            self._idle.set,
            self.warnings.append,
        )
        self.runner.start().result(10.0)
        self.number = -1

    def tick(self, *arrivals: object) -> None:
        self.number += 1
        self._idle.clear()
        self.runner.tick(self.number * TICK_NS, arrivals)  # type: ignore[arg-type]
        assert self._idle.wait(10.0)

    def ticks(self, count: int) -> None:
        for _ in range(count):
            self.tick()

    @property
    def sent(self) -> list[tuple[str, int]]:
        return [(channel, stamp.sim_time_ns // TICK_NS) for channel, _, stamp in self.outlet.sent]


def failures_of(agent: Flown) -> list[str]:
    """What was reported as a failure, without the line of this file in which it arose: one is told of each."""
    told = [status.activity for status in agent.outlet.reports if status.failed]
    parts = [re.fullmatch(r"(.*) \(test_runner\.py:\d+\)", text) for text in told]
    assert all(parts), told
    return [part[1] for part in parts if part]


@pytest.fixture
def flown() -> Iterator[list[Flown]]:
    agents: list[Flown] = []
    yield agents
    for agent in agents:
        agent.runner.ask_to_stop()
        assert agent.runner.join(5.0)


class Napper(Agent):
    async def fly(self) -> None:
        for _ in range(3):
            self.ua.transmit("nap", b"")
            await self.sleep(0.07)
        async for now_s in self.every(0.2):
            self.ua.transmit("every", b"")
            if now_s > 0.9:
                break


def test_what_fly_transmits_after_an_await_has_the_stamp_of_its_tick(flown: list[Flown]) -> None:
    flown.append(Flown(Napper))
    flown[0].ticks(30)
    naps = [tick for channel, tick in flown[0].sent if channel == "nap"]
    assert naps == [0, 2, 4]
    assert [tick for channel, tick in flown[0].sent if channel == "every"] == [6, 10, 14, 18, 22]


def test_a_period_shorter_than_a_tick_comes_once_per_tick(flown: list[Flown]) -> None:
    class Hasty(Agent):
        async def fly(self) -> None:
            async for _ in self.every(0.01):
                self.ua.transmit("hasty", b"")

    flown.append(Flown(Hasty))
    flown[0].ticks(6)
    assert [tick for channel, tick in flown[0].sent if channel == "hasty"] == [0, 1, 2, 3, 4, 5]


def test_any_rate_keeps_its_grid(flown: list[Flown]) -> None:
    """Of 15 Hz every third instant is a tick: 3 * 66 666 667 ns are a nanosecond after it, and hung the run."""
    rates_hz = range(1, 21)

    class Rates(Agent):
        async def fly(self) -> None:
            await asyncio.gather(*map(self._beat, rates_hz))

        async def _beat(self, hz: int) -> None:
            async for _ in self.every(1 / hz):
                self.ua.transmit(str(hz), b"")

    flown.append(Flown(Rates))
    flown[0].ticks(61)
    for hz in rates_hz:
        grid = [-(-20 * k // hz) for k in range(3 * hz + 1)]
        assert [tick for channel, tick in flown[0].sent if channel == str(hz)] == grid, hz


def test_periods_at_the_ends_of_what_numbers_can_say(flown: list[Flown]) -> None:
    class Odd(Agent):
        async def fly(self) -> None:
            for wrong in (math.inf, math.nan, 0.0):
                with pytest.raises(ValueError, match="above 0 s, and finite"):
                    await anext(self.every(wrong))
            with pytest.raises(ValueError, match="timeout_s has to be a number of seconds"):
                await self.ua.wait_for(lambda _: False, timeout_s=math.nan)
            async for _ in self.every(1e-12):
                self.ua.transmit("hasty", b"")

    flown.append(Flown(Odd))
    flown[0].ticks(3)
    assert [tick for channel, tick in flown[0].sent if channel == "hasty"] == [0, 1, 2]


def test_random_numbers_are_those_of_run_and_node(flown: list[Flown]) -> None:
    class Gambler(Agent):
        async def fly(self) -> None:
            self.ua.transmit("dice", self.rng.bytes(4))

    for seed in (3, 3, 4):
        flown.append(Flown(Gambler, seed=seed))
        flown[-1].tick()
    first, again, other = (next(p for c, p, _ in a.outlet.sent if c == "dice") for a in flown)
    assert first == again != other
    assert rng_of(3, "0").bytes(4) != rng_of(3, "1").bytes(4)


@pytest.mark.parametrize("error", [RuntimeError("a\ud83d"), CommandFailed("a\ud83d")])
def test_an_error_that_is_no_text_in_utf8_is_told_all_the_same(
    flown: list[Flown], error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(logging.getLogger("agent"), "disabled", True)  # xdist cannot carry such a text

    class Careless(Agent):
        async def fly(self) -> None:
            raise error

    flown.append(Flown(Careless))
    flown[0].tick()
    (status,) = flown[0].outlet.reports
    assert status.failed
    line = Careless.fly.__code__.co_firstlineno + 1
    assert decode(encode(status), AgentStatus).activity.endswith(f"a\\ud83d (test_runner.py:{line})")


def test_a_slow_agent_keeps_the_tick_open_and_nothing_else(flown: list[Flown]) -> None:
    class Slow(Agent):
        def on_tick(self, sim_time_ns: int) -> None:
            time.sleep(0.02)
            self.ua.transmit("slow", b"")

    flown.append(Flown(Slow))
    flown[0].ticks(5)
    assert flown[0].sent == [("team", 0), *(("slow", n) for n in range(5))]


def test_an_agent_that_blocks_is_told_of_once_a_tick_with_its_line(flown: list[Flown]) -> None:
    at_work, go_on = threading.Event(), threading.Event()

    class Blocking(Agent):
        def on_tick(self, sim_time_ns: int) -> None:
            at_work.set()
            go_on.wait(10.0)

    flown.append(Flown(Blocking))
    go_on.set()
    flown[0].ticks(2)
    go_on.clear()
    at_work.clear()
    runner, now_s = flown[0].runner, time.monotonic()
    runner.tick(2 * TICK_NS, ())
    assert at_work.wait(10.0)
    assert runner.blocked(now_s + 1.0) == ""
    line = Blocking.on_tick.__code__.co_firstlineno + 2
    place = f"in test_runner.py, line {line} (on_tick)"
    told = f"the tick at 0.10 s takes more than 5 s of wall time, {place}; the run waits for it"
    assert runner.blocked(now_s + 7.0) == told
    assert runner.blocked(now_s + 20.0) == ""
    go_on.set()


def test_a_coroutine_that_never_awaits_sim_time_is_told_of_with_its_line(flown: list[Flown]) -> None:
    """Most of the time its thread is in asyncio's code; another task of the agent waits meanwhile."""
    spins, at_work = threading.Event(), threading.Event()

    class Spinning(Agent):
        async def fly(self) -> None:
            waits = asyncio.create_task(self.sleep(3600.0))
            while True:
                await self.spin()
                await self.sleep(0.05)
            await waits

        async def spin(self) -> None:
            at_work.set()
            while spins.is_set():  # noqa: ASYNC110 - what it is about
                await asyncio.sleep(0)

    flown.append(Flown(Spinning))
    flown[0].ticks(1)
    runner, line = flown[0].runner, Spinning.spin.__code__.co_firstlineno + 3
    for _ in range(20):
        at_work.clear()
        spins.set()
        flown[0].number += 1
        flown[0]._idle.clear()
        runner.tick(flown[0].number * TICK_NS, ())
        assert at_work.wait(10.0)
        begin_s = time.monotonic()
        while not (told := runner.blocked(time.monotonic() + 7.0)) and time.monotonic() < begin_s + 2.5:
            time.sleep(0.001)  # a look may fall between two lines
        spins.clear()
        assert flown[0]._idle.wait(10.0)
        place = re.search(r"in test_runner\.py, line (\d+) \(spin\)", told)
        assert place, told
        assert int(place[1]) in range(line - 1, line + 2)


def test_an_agent_that_kept_everybody_from_looking_is_told_of_afterwards(
    flown: list[Flown], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a regular expression does, which holds the interpreter's lock until it is done."""
    flown.append(Flown(Napper))
    flown[0].ticks(1)
    runner = flown[0].runner
    assert runner.blocked(time.monotonic()) == ""
    monkeypatch.setattr("bridge.agents.running.runner.BLOCKED_S", 0.0)
    flown[0].ticks(1)
    assert (
        runner.blocked(time.monotonic()) == "the tick at 0.05 s took 0 s of wall time; the run waited for it"
    )
    assert runner.blocked(time.monotonic()) == ""


def test_an_agent_with_an_on_tick_of_its_own_still_transmits_its_package(flown: list[Flown]) -> None:
    class Own(Agent):
        def on_tick(self, sim_time_ns: int) -> None:
            self.ua.transmit("own", b"")

    flown.append(Flown(Own))
    flown[0].runner._agent.transmit_config = Transmit(every_ticks=2)
    flown[0].ticks(4)
    assert flown[0].sent == [("team", 0), ("own", 0), ("own", 1), ("team", 2), ("own", 2), ("own", 3)]


def test_what_an_agent_records_is_in_its_own_folder_with_sim_time(flown: list[Flown], tmp_path: Path) -> None:
    class Scribe(Agent):
        def on_tick(self, sim_time_ns: int) -> None:
            self.record("seen", count=self.ua.received, who="7")

    flown.append(Flown(Scribe, folder=tmp_path / "agents" / "1"))
    flown[0].ticks(3)
    lines = (tmp_path / "agents" / "1" / "seen.jsonl").read_text().splitlines()
    assert [json.loads(line) for line in lines] == [
        {"sim_time_s": 0.05 * n, "count": 0, "who": "7"} for n in range(3)
    ]
    agent = flown[0].runner._agent
    (agent.directory / "map.bin").write_bytes(b"1")
    assert (tmp_path / "agents" / "1" / "map.bin").exists()
    with pytest.raises(ValueError, match="cannot be part of a key"):
        agent.record("../../etc", a=1)


def test_what_an_agent_records_on_its_way_out_is_behind_what_it_recorded_before(tmp_path: Path) -> None:
    class Scribe(Agent):
        async def fly(self) -> None:
            try:
                async for now_s in self.every(0.05):
                    self.record("seen", name="way", at_s=now_s)
            finally:
                self.record("seen", name="end")

    agent = Flown(Scribe, folder=tmp_path)
    agent.ticks(3)
    agent.runner.ask_to_stop()
    assert agent.runner.join(5.0)
    lines = [json.loads(line) for line in (tmp_path / "seen.jsonl").read_text().splitlines()]
    assert [line["name"] for line in lines] == ["way", "way", "way", "end"]


class Answering:
    """What became of each command, by its verb: (outcome, value)."""

    def __init__(self, outcomes: dict[str, tuple[str, object]]) -> None:
        self.outcomes = outcomes
        self.asked: list[tuple[str, dict[str, Any]]] = []

    def answer(self, agent: Flown) -> None:
        """Give the results of all commands with the next tick."""
        commands, agent.outlet.commands[:] = list(agent.outlet.commands), []
        events = []
        for (verb, on_event), goal in zip(commands, agent.outlet.goals, strict=True):
            self.asked.append((verb, json.loads(goal.arguments or "{}")))
            outcome, value = self.outcomes.get(verb, ("reached", None))
            text = "" if value is None else json.dumps(value)
            success = outcome in ("reached", "superseded")
            event = CommandEvent(
                CommandEvent.RESULT, success, f"{verb} {outcome}", outcome=outcome, value=text
            )
            events.append((on_event, event))
        agent.outlet.goals.clear()
        agent.tick(lambda ua: [on_event(event) for on_event, event in events])


def test_commands_give_values_and_typed_errors(flown: list[Flown]) -> None:
    heard: list[object] = []

    class Busy(Agent):
        async def fly(self) -> None:
            ua = self.ua
            heard.append(await ua.parameters.get("RTL_ALT"))
            heard.append(await ua.message("WIND"))
            heard.append(await ua.missions.download("fence"))
            heard.append(await ua.velocity(1.0, -2.0, yaw_rate_dps=5.0))
            for error, call in (
                (CommandRefused, ua.parameters.set("RTL_ALT", 5.0)),
                (CommandTimedOut, ua.goto_ned(1.0, 2.0, -3.0, frame="offset")),
                (CommandInterrupted, ua.orbit(47.0, 8.0, 20.0, 30.0)),
            ):
                with pytest.raises(error, match="UA 1: "):
                    await call
            await ua.mission([{"command": 16, "params": [0] * 7}])
            heard.append("flown")

    flown.append(Flown(Busy))
    answers = Answering(
        {
            "parameter_get": ("reached", 1500.0),
            "message": ("reached", {"direction": 90.0, "speed": None}),
            "mission_download": ("reached", []),
            "velocity": ("superseded", None),
            "parameter_set": ("refused", None),
            "goto_ned": ("timed_out", None),
            "orbit": ("interrupted", None),
            "mission_upload": ("reached", 1),
        }
    )
    flown[0].tick()
    for _ in range(9):
        answers.answer(flown[0])
    assert heard == [1500.0, {"direction": 90.0, "speed": None}, [], False, "flown"]
    assert answers.asked[0] == ("parameter_get", {"name": "RTL_ALT"})
    assert answers.asked[3][1]["yaw_rate_dps"] == 5.0
    assert "yaw_deg" not in answers.asked[3][1]
    assert [verb for verb, _ in answers.asked[-2:]] == ["mission_upload", "mission"]


def test_every_command_of_an_agent_is_one_of_the_daemons_with_its_arguments() -> None:
    """What `ua` sends is what the commander takes, name by name."""

    class Noted(Commands):
        def __init__(self) -> None:
            self.sent: list[tuple[str, CommandGoal]] = []

        async def command(self, verb: str, goal: Any = None, on_feedback: Any = None) -> CommandEvent:
            self.sent.append((verb, goal or CommandGoal()))
            return CommandEvent(
                CommandEvent.RESULT, True, outcome="reached", value="{}" if verb == "message" else "1"
            )

    async def everything(ua: Noted) -> None:
        await ua.disarm(force=True)
        await ua.change_speed(5.0, "ground")
        await ua.reboot()
        await ua.goto(47.0, 8.0, 20.0, yaw_deg=10.0, frame="amsl")
        await ua.goto_ned(1.0, 2.0, 3.0, yaw_deg=4.0)
        await ua.velocity(1.0, 2.0, 3.0, yaw_deg=4.0, yaw_rate_dps=5.0)
        await ua.follow(47.0, 8.0, 20.0, velocity_ned_mps=(1.0, 2.0, 3.0), yaw_deg=4.0)
        await ua.orbit(47.0, 8.0, 20.0, 30.0)
        await ua.mission([])
        await ua.missions.set_current(1)
        await ua.missions.fly(first=2)
        await ua.missions.clear("rally")
        await ua.missions.download()
        await ua.parameters.get("X")
        await ua.parameters.set("X", 1.0)
        await ua.parameters.all()
        await ua.message("WIND")
        await ua.send("WIND", speed=1.0)

    ua = Noted()
    asyncio.run(everything(ua))
    for verb, goal in ua.sent:
        assert set(json.loads(goal.arguments or "{}")) <= set(argument_names(verb)), verb


@pytest.mark.parametrize("method", ["on_tick", "on_packet", "on_measurement", "transmit_package", "package"])
def test_an_async_method_that_nobody_would_await_is_refused_by_name(tmp_path: Path, method: str) -> None:
    file = tmp_path / "patrol.py"
    file.write_text(
        "from bridge.agents import Agent\n\n\nclass Patrol(Agent):\n"
        f"    async def {method}(self, *_):\n        pass\n"
    )
    with pytest.raises(OwnCodeError, match=f"Patrol.{method} in .*patrol.py is an async def"):
        load_class(str(file), "Patrol")
    assert f"patrol.py:5: Patrol.{method} is an async def" in mistake_in(str(file), "Patrol")


@pytest.mark.parametrize("bases", ["Agent", "Base"])
def test_a_fly_that_cannot_be_awaited_is_refused_by_name(tmp_path: Path, bases: str) -> None:
    file = tmp_path / "patrol.py"
    own = "    pass\n" if bases == "Base" else "    def fly(self):\n        pass\n"
    file.write_text(
        "from bridge.agents import Agent\n\n\nclass Base(Agent):\n    def fly(self):\n        pass\n\n\n"
        f"class Patrol({bases}):\n{own}"
    )
    with pytest.raises(
        OwnCodeError, match=r"Patrol\.fly in .*patrol\.py is a plain def: make it an async def"
    ):
        load_class(str(file), "Patrol")
    if bases == "Agent":
        assert f"{file}:10: Patrol.fly is a plain def" in mistake_in(str(file), "Patrol")


@pytest.mark.parametrize(
    ("method", "wrong"),
    [
        ("def on_packet(self, sender, channel, payload)", "(sender, channel, payload, reception)"),
        ("def on_packet(self, sender, *, reception, **more)", "(sender, channel, payload, reception)"),
        ("def on_tick(self)", "(sim_time_ns)"),
        ("def on_tick(self, sim_time_ns, more, why=1)", "(sim_time_ns)"),
        ("def on_measurement()", "(measurement)"),
        ("def transmit_package(self)", "(sim_time_ns)"),
        ("def __init__(self)", "(ua, config, transmit)"),
        ("async def fly(self, height_m)", "()"),
        ("def on_packet(self, *given)", ""),
        ("def on_packet(self, sender, channel, /, payload=b'', reception=None, *, more=0)", ""),
        ("def __init__(self, ua, *given, **more)", ""),
        ("async def fly(self, height_m=40.0)", ""),
        ("@staticmethod\n    def on_tick(sim_time_ns)", ""),
    ],
)
def test_a_method_that_cannot_be_called_as_it_is_is_refused_with_its_line(
    tmp_path: Path, method: str, wrong: str
) -> None:
    file = tmp_path / "patrol.py"
    file.write_text(f"from lostlink import Agent\n\n\nclass Patrol(Agent):\n    {method}: ...\n")
    name = re.findall(r"def (\w+)", method)[0]
    says = f"{file}:5: Patrol.{name} cannot be called with {wrong}, as it is: " if wrong else ""
    assert mistake_in(str(file), "Patrol").startswith(says)
    if not wrong:
        assert mistake_in(str(file), "Patrol") == ""
        assert load_class(str(file), "Patrol").__name__ == "Patrol"
        return
    with pytest.raises(OwnCodeError) as told:
        load_class(str(file), "Patrol")
    assert str(told.value) == mistake_in(str(file), "Patrol")


def test_what_may_take_anything_is_not_refused(tmp_path: Path) -> None:
    file = tmp_path / "patrol.py"
    file.write_text(
        "import functools\nfrom lostlink import Agent\n\n"
        "def given_more(method):\n"
        "    @functools.wraps(method)\n"
        "    def called(self, *given): return method(self, *given, 1)\n"
        "    return called\n\n"
        "class Made(type):\n    def __call__(cls, *given): return cls.__new__(cls)\n\n"
        "class Patrol(Agent, metaclass=Made):\n"
        "    def __init__(self): ...\n"
        "    @given_more\n    def on_tick(self, sim_time_ns, more): ...\n"
    )
    assert mistake_in(str(file), "Patrol") == ""
    assert load_class(str(file), "Patrol").__name__ == "Patrol"


def test_a_callback_that_cannot_be_called_as_it_is_is_told_with_the_line_that_gave_it(
    flown: list[Flown],
) -> None:
    class Listens(Agent):
        async def fly(self) -> None:
            self.ua.on_tick(print)
            self.ua.on_packet(self.heard)  # type: ignore[arg-type]

        def heard(self, payload: bytes) -> None: ...

    flown.append(Flown(Listens))
    flown[0].tick()
    line = Listens.fly.__code__.co_firstlineno + 2
    [told] = [status.activity for status in flown[0].outlet.reports if status.failed]
    given = "Listens.heard cannot be called with (sender, channel, payload, reception), as it is: too many"
    assert f".{given} positional arguments (test_runner.py:{line})" in told
    assert told.startswith("TypeError in flight: on_packet: test_a_callback")


class ForgetsItsArguments(Agent):
    def __init__(self) -> None:
        """It takes none."""


class Exits(Agent):
    def __init__(self, *_: Any) -> None:
        sys.exit("that was it")


class LooksUp(Agent):
    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.altitude_m = self.options["altitud"]


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (LooksUp, "KeyError in its constructor: 'altitud'"),
        (Exits, "SystemExit in its constructor: that was it"),
        (
            ForgetsItsArguments,
            "TypeError in its constructor: ForgetsItsArguments.__init__() takes 1 positional",
        ),
    ],
)
def test_an_agent_that_cannot_be_made_fails_at_the_first_tick(
    flown: list[Flown], make: type[Agent], says: str
) -> None:
    flown.append(Flown(make))
    agent = flown[0]
    assert agent.outlet.reports == []
    agent.ticks(3)
    [failed] = agent.outlet.reports
    assert (failed.failed, failed.header.stamp.ns) == (True, 0)
    assert failed.activity.startswith(says)
    assert agent.sent == []


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("import nowhere_to_be_found", r".*mine\.py:1: ModuleNotFoundError: No module named"),
        ("import sys; sys.exit(3)", r".*mine\.py:1: SystemExit: 3"),
        ("class Own: pass", "Own in .*mine.py is no subclass of bridge.agents.Agent"),
    ],
)
def test_an_agent_whose_file_cannot_be_loaded_fails_by_name(
    flown: list[Flown], tmp_path: Path, text: str, says: str, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "mine.py"
    file.write_text(text)
    flown.append(Flown(lambda *given: load_class(str(file), "Own")(*given)))  # type: ignore[arg-type]
    flown[0].tick()
    [failed] = flown[0].outlet.reports
    assert failed.failed
    assert re.match(says, failed.activity)
    assert re.match(says, caplog.records[-1].getMessage())


def test_results_of_commands_come_with_a_tick(flown: list[Flown]) -> None:
    class Commander(Agent):
        async def fly(self) -> None:
            await self.ua.arm()
            self.ua.transmit("armed", b"")
            try:
                await self.ua.land()
            except CommandFailed as error:
                self.ua.transmit("refused", str(error).encode())

    flown.append(Flown(Commander))
    agent = flown[0]
    agent.ticks(3)
    [(verb, on_event)] = agent.outlet.commands
    assert verb == "arm"
    agent.tick(lambda ua: on_event(CommandEvent(CommandEvent.RESULT, True, "")))
    [_, (verb, on_event)] = agent.outlet.commands
    agent.tick(lambda ua: on_event(CommandEvent(CommandEvent.RESULT, False, "no ground here")))
    assert [entry for entry in agent.sent if entry[0] != "team"] == [("armed", 3), ("refused", 4)]


def test_waits_for_states_and_their_time_outs(flown: list[Flown]) -> None:
    class Waiter(Agent):
        async def fly(self) -> None:
            await self.ua.wait_for(lambda state: state.armed)
            self.ua.transmit("armed", b"")
            for timeout_s in (0.2, 0.03, 0.0, 1.1):  # 1.1e9 is a little less than 1.1 * 1e9
                with pytest.raises(TimeoutError, match=r"still waiting at \d\.\d[05] s"):
                    await self.ua.wait_for(lambda state: not state.armed, timeout_s=timeout_s)
                self.ua.transmit("late", b"")
            await self.ua.wait_for(lambda state: not state.armed, timeout_s=0.1)
            self.ua.transmit("in_time", b"")

    flown.append(Flown(Waiter))
    agent = flown[0]
    agent.ticks(2)
    agent.tick(lambda ua: ua.take_state(AircraftState(armed=True)))
    agent.ticks(28)
    agent.tick(lambda ua: ua.take_state(AircraftState(armed=False)))
    late = [("late", tick) for tick in (6, 7, 7, 29)]
    assert [entry for entry in agent.sent if entry[0] != "team"] == [("armed", 2), *late, ("in_time", 31)]


@pytest.mark.parametrize(
    ("warns", "why"), [(True, ": PreArm: Fences enabled, but none selected"), (False, "")]
)
def test_a_take_off_that_waits_for_long_says_why(flown: list[Flown], warns: bool, why: str) -> None:
    class Climber(Agent):
        async def fly(self) -> None:
            await self.take_off(10.0)

    flown.append(Flown(Climber))
    agent = flown[0]
    if warns:
        agent.tick(lambda ua: ua.take_warning("PreArm: Fences enabled, but none selected"))
    waits = "waits until the autopilot is ready to arm"
    while agent.number < 59.9 * 20:
        agent.tick()
    assert [report.activity for report in agent.outlet.reports] == [waits]
    while agent.number < 60.1 * 20:
        agent.tick()
    assert [report.activity for report in agent.outlet.reports] == [waits, f"still {waits}{why}"]
    while agent.number < 180.2 * 20:
        agent.tick()
    assert failures_of(agent) == [
        f"the autopilot was not ready to arm within 180 s of sim time{why}; the log of its host has all that it said"
    ]


class Looker(Agent):
    """Looks at the packages and at who was heard, at the ticks that are told, and keeps what it saw."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.looks = False
        self.seen: list[tuple[list[str], int, list[str]]] = []

    def on_tick(self, sim_time_ns: int) -> None:
        super().on_tick(sim_time_ns)
        if self.looks:
            status = self.ua.comm_status
            heard = list(status.node) if status is not None else []
            self.seen.append((sorted(self.latest), len(self.latest), heard))


def test_what_is_no_package_is_counted_when_the_agent_looks_and_does_not_blow_up_in_its_code(
    flown: list[Flown],
) -> None:
    flown.append(Flown(Looker))
    agent, reception = flown[0], Reception(0, 0, 0)
    good = encode(DataPackage(Header.at(5, "2")))
    status = CommunicationStatus(node=("2",), delivered=(True,))
    agent.tick(
        lambda ua: ua.take_packet("0", "team", b"garbage", reception),
        lambda ua: ua.take_packet("2", "team", good, reception),
        lambda ua: ua.take_comm_status(lambda: status),
    )
    agent.tick()
    assert (agent.runner.ua.received, agent.runner.ua.malformed) == (2, 0)
    looker = cast("Looker", agent.runner._agent)
    looker.looks = True
    agent.tick()
    agent.tick(lambda ua: ua.take_comm_status(lambda: ua.read(b"garbage", CommunicationStatus)))
    assert looker.seen == [(["2"], 1, ["2"])] * 2
    assert agent.runner.ua.malformed == 2
    with pytest.raises(KeyError):
        looker.latest["0"]
    assert looker.latest.raw == {"0": b"garbage", "2": good}
    agent.tick(lambda ua: ua.take_packet("0", "team", good, reception))
    assert looker.seen[-1] == (["0", "2"], 2, ["2"])
    assert looker.latest["2"] is looker.latest["2"]
    assert not any(status.failed for status in agent.outlet.reports)


class OwnReader(Agent):
    """Decodes in its callback."""

    def on_packet(self, sender: str, channel: str, payload: bytes, reception: Reception) -> None:
        decode(payload, DataPackage)


def test_a_packet_that_an_agents_own_callback_cannot_read_is_counted_and_the_rest_goes_on(
    flown: list[Flown],
) -> None:
    flown.append(Flown(OwnReader))
    agent, reception = flown[0], Reception(0, 0, 0)
    agent.tick(
        lambda ua: ua.take_packet("0", "team", b"garbage", reception),
        lambda ua: ua.take_packet("2", "team", encode(DataPackage()), reception),
    )
    agent.tick()
    assert (agent.runner.ua.received, agent.runner.ua.malformed) == (2, 1)
    assert not any(status.failed for status in agent.outlet.reports)


@pytest.mark.parametrize("where", ["fly", "tick", "task", "dropped task"])
def test_what_the_agent_raises_is_reported_once_with_its_place(flown: list[Flown], where: str) -> None:
    class Faulty(Agent):
        async def fly(self) -> None:
            if where == "fly":
                raise ArithmeticError("mine")
            if where == "task":
                self.task = asyncio.create_task(self.mistake())
                await asyncio.Event().wait()
            if where == "dropped task":
                asyncio.create_task(self.mistake())  # noqa: RUF006 - what many write
                await asyncio.Event().wait()

        async def mistake(self) -> None:
            raise ArithmeticError("mine")

        def on_tick(self, sim_time_ns: int) -> None:
            if where == "tick":
                raise ArithmeticError("mine")

    flown.append(Flown(Faulty))
    flown[0].ticks(4)
    failed = [status.activity for status in flown[0].outlet.reports if status.failed]
    when = {"fly": "in flight", "tick": "at a tick"}.get(where, "in a task of its own")
    codes = {"fly": Faulty.fly.__code__, "tick": Faulty.on_tick.__code__}
    line = codes.get(where, Faulty.mistake.__code__).co_firstlineno + (1 if "task" in where else 2)
    assert failed == [f"ArithmeticError {when}: mine (test_runner.py:{line})"]


@pytest.mark.parametrize("error", [SystemExit(3), KeyboardInterrupt("3")])
@pytest.mark.parametrize(
    ("where", "place"), [("tick", "at a tick"), ("packet", "in a callback"), ("task", "in its thread")]
)
def test_a_callback_that_exits_is_reported_by_what_it_raised(
    where: str, place: str, error: BaseException
) -> None:
    class Exiting(Agent):
        async def fly(self) -> None:
            if where == "task":
                self.task = asyncio.create_task(self.exit())
            await self.sleep(1000.0)

        async def exit(self) -> None:
            raise error

        def on_tick(self, sim_time_ns: int) -> None:
            if where == "tick":
                raise error

        def on_packet(self, sender: str, channel: str, payload: bytes, reception: Reception) -> None:
            if where == "packet":
                raise error

    agent = Flown(Exiting)
    agent.tick(lambda ua: ua.take_packet("0", "mine", b"", Reception(0, 0, 0)))
    assert failures_of(agent) == [f"{type(error).__name__} {place}: 3"]
    agent.runner.ask_to_stop()
    assert agent.runner.join(5.0)


def test_an_exception_without_a_text_is_told_by_its_name_alone(flown: list[Flown]) -> None:
    class Faulty(Agent):
        async def fly(self) -> None:
            raise AssertionError

    flown.append(Flown(Faulty))
    flown[0].tick()
    assert failures_of(flown[0]) == ["AssertionError in flight"]


FAULTS = """\
import json
from bridge.agents import Agent

class Within(Agent):
    async def fly(self):
        json.loads("{")

class Lines(Agent):
    def on_tick(self, sim_time_ns):
        raise ValueError("one\\ntwo")

class Group(Agent):
    async def fly(self):
        try:
            json.loads("{")
        except ValueError as error:
            raise ExceptionGroup("several", [error])

class Refused(Agent):
    async def fly(self):
        await self.ua.arm()
"""


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("Within", "JSONDecodeError in flight: Expecting .* (careless.py:6)"),
        ("Lines", "ValueError at a tick: one (careless.py:10)\ntwo"),
        ("Group", "ExceptionGroup in flight: several .* (careless.py:15)"),
        ("Refused", "arm: arm refused: no (careless.py:21)"),
    ],
)
def test_a_failures_place_is_the_innermost_in_the_agents_code_behind_the_first_line(
    flown: list[Flown], tmp_path: Path, name: str, says: str
) -> None:
    file = tmp_path / "careless.py"
    file.write_text(FAULTS)
    flown.append(Flown(load_class(str(file), name)))
    agent = flown[0]
    agent.tick()
    refusal = CommandEvent(CommandEvent.RESULT, False, "arm refused: no", outcome="refused")
    for _, on_event in agent.outlet.commands:
        agent.tick(lambda ua, on_event=on_event: on_event(refusal))
    [failed] = [status.activity for status in agent.outlet.reports if status.failed]
    assert re.fullmatch(re.escape(says).replace(r"\.\*", ".*"), failed), failed


def test_of_a_group_of_exceptions_the_first_is_told_by_name(flown: list[Flown]) -> None:
    class Divided(Agent):
        async def part(self) -> None:
            raise CommandTimedOut("UA 1: goto: timed out")

        async def fly(self) -> None:
            async with asyncio.TaskGroup() as group:
                group.create_task(self.part())

    flown.append(Flown(Divided))
    flown[0].tick()
    line = Divided.part.__code__.co_firstlineno + 1
    assert [status.activity for status in flown[0].outlet.reports] == [
        "ExceptionGroup in flight: unhandled errors in a TaskGroup (1 sub-exception): "
        f"CommandTimedOut: UA 1: goto: timed out (test_runner.py:{line})"
    ]


def test_an_end_that_waits_for_sim_time_does_not_hang() -> None:
    class Stubborn(Agent):
        async def fly(self) -> None:
            try:
                await asyncio.Event().wait()
            finally:
                await self.sleep(1000.0)

    agent = Flown(Stubborn)
    agent.ticks(2)
    agent.runner.ask_to_stop()
    assert agent.runner.join(5.0)
    assert agent.outlet.reports[-1].activity == "is stopped"


@pytest.mark.parametrize("how", ["exit", "cancelled"])
def test_a_thread_that_ends_says_so_and_leaves_no_tick_open(how: str) -> None:
    class Gone(Agent):
        async def fly(self) -> None:
            await self.sleep(0.1)
            if how == "exit":
                sys.exit("enough")
            task = asyncio.create_task(self.sleep(1.0))
            task.cancel()
            await task

    agent = Flown(Gone)
    agent.ticks(3)
    [failed] = failures_of(agent)
    assert (
        failed
        == {
            "exit": "SystemExit in its thread: enough",
            "cancelled": "CancelledError in flight: it awaited what had been cancelled",
        }[how]
    )
    agent.runner.ask_to_stop()
    assert agent.runner.join(5.0)


@pytest.mark.parametrize("asked", ["default", "ignore"])
def test_a_forgotten_await_is_told_with_its_place_to_each_agent_and_is_not_in_the_record(
    flown: list[Flown], asked: Literal["default", "ignore"]
) -> None:
    """Once for each place, whatever Python was asked to say of warnings, or has said already."""

    class Forgetful(Agent):
        async def fly(self) -> None:
            while True:
                asyncio.sleep(1.0)  # type: ignore[unused-coroutine]
                await asyncio.sleep(0.01)

    with warnings.catch_warnings(record=True):
        warnings.simplefilter(asked)
        for _ in range(2):
            flown.append(Flown(Forgetful))
            flown[-1].ticks(3)
    line = Forgetful.fly.__code__.co_firstlineno + 2
    told = f"coroutine 'sleep' was never awaited: put await before it (test_runner.py, line {line})"
    assert [each.warnings for each in flown] == [[told], [told]]
    assert [each.outlet.reports for each in flown] == [[], []]


def test_an_outcome_that_is_looked_at_later_is_no_mistake(flown: list[Flown]) -> None:
    class Patient(Agent):
        async def fly(self) -> None:
            waiting = asyncio.create_task(self.ua.wait_for(lambda state: state.armed, timeout_s=0.1))
            await self.sleep(0.5)
            try:
                await waiting
            except TimeoutError:
                self.ua.transmit("late", b"")
            self.forgotten = asyncio.create_task(self.ua.wait_for(lambda state: state.armed, timeout_s=0.1))

    flown.append(Flown(Patient))
    flown[0].ticks(12)
    assert ("late", 10) in flown[0].sent
    assert not any(status.failed for status in flown[0].outlet.reports)
    flown[0].ticks(6)
    [failed] = [status.activity for status in flown[0].outlet.reports if status.failed]
    assert failed.startswith("TimeoutError in a task of its own")


def test_what_is_transmitted_on_the_way_out_has_no_effect(flown: list[Flown]) -> None:
    class Polite(Agent):
        async def fly(self) -> None:
            try:
                await asyncio.Event().wait()
            finally:
                self.ua.transmit("bye", b"")

    flown.append(Flown(Polite))
    flown[0].ticks(2)
    flown[0].runner.ask_to_stop()
    assert flown[0].runner.join(5.0)
    assert ("bye", 1) not in flown[0].sent
    assert flown[0].outlet.reports[-1].sent == len(flown[0].sent)
