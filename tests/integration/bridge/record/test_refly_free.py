"""A run is flown again with what programs transmitted in it as free nodes, and without these programs."""

from __future__ import annotations

import asyncio
import json
import signal
from collections import Counter
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import pytest

from bridge.agents import connect_ua
from bridge.agents.client import UaClient
from bridge.bus.identity.roster import node_identity
from bridge.bus.keys import Keys
from bridge.bus.session import Stamp
from lostlink import RunOver, load_run
from tests.integration.bridge.conftest import Run, StartRun
from tests.integration.bridge.radio.test_air_beside import CSMA, FLAT, TICK_NS, scenario
from tests.integration.bridge.record.test_refly import refly
from tests.warm import Command

AGENT = f"{Path(__file__).with_name('answering_agent.py')}:Answering"
FREE = {"type": "free"}
NODES: list[dict[str, Any]] = [
    {"id": 0, "groups": ["team"], "agent": {"type": "own", "class": AGENT}},
    {"id": 1, "groups": ["team"], "home": {"east_m": 60.0}, "networks": ["main"], "agent": FREE},
    {"id": "probe", "kind": "ground", "groups": ["team"], "place": {"north_m": 100.0}, "agent": FREE},
    {"id": "raw", "kind": "ground", "place": {"north_m": -100.0}, "networks": ["main"], "agent": FREE},
]
IDEAL = {name: value for name, value in CSMA.items() if name != "medium"}
MEDIA = {"csma": CSMA | {"mtu_bytes": 1500}, "ideal": IDEAL | {"mtu_bytes": 1500}}
MANY = pytest.param("many", marks=pytest.mark.long)
ENOUGH = {"1": 40, "probe": 40, "raw": 40}
"""Packets of each that are heard before a run is done, however late a program joins it."""
Say = Callable[[int], object]


def flies(
    start_run: StartRun,
    medium: str,
    processes: str,
    duration_s: float = 600.0,
    enough: dict[str, int] | None = None,
    **more: Any,
) -> Run:
    """A run that is done when node 0 heard enough, which programs are to join."""
    agent = NODES[0]["agent"] | {"options": {} if enough is None else {"enough": enough}}
    nodes = [NODES[0] | {"agent": agent}, *NODES[1:]]
    content: dict[str, Any] = {
        "radio": MEDIA[medium],
        "networks": {"mesh": MEDIA["ideal"]},
        "transmit": FLAT | {"phase_s": "drawn"},
    }
    text = scenario(nodes, **(content | more))
    run = start_run(scenario=text, duration_s=duration_s, speed="2", processes=processes)
    run.wait_for("sim time")
    return run


async def each_tick(program: UaClient, say: Say) -> None:
    """Have a program do something at each tick, with the number of the tick, until the run is over."""
    ticks = iter(range(1_000_000))
    program.on_tick(lambda _: say(next(ticks)))
    with suppress(RunOver):
        await program.wait_for(lambda _: False)


async def probe(run: Run, beside: Say = lambda _: None) -> None:
    """Packets of all kinds: to all, one, a group, by another radio, with handling, too long for the radio."""
    async with connect_ua(run.directory, "probe", is_sender=True) as program:

        def say(number: int) -> None:
            beside(number)
            program.transmit("test", bytes(300))
            program.transmit("test", bytes(1400), to="0")
            for _ in range(2):
                program.transmit("test", number.to_bytes(2, "big"), to="0", key="state", priority=number % 3)
            program.transmit("test", bytes(100), to="team", lifetime_s=0.02)
            program.transmit("test", bytes(100), to="0", radio="mesh")
            if number % 3 == 2:
                program.transmit("test", bytes(2000), to="team")

        await each_tick(program, say)


async def pilot(run: Run, beside: Say = lambda _: None) -> None:
    """A UA's program: it gives commands, too."""
    async with connect_ua(run.directory, 1, is_sender=True) as program:
        await program.set_mode("GUIDED")

        def say(number: int) -> None:
            beside(number)
            program.transmit("test", bytes(200 + number))

        await each_tick(program, say)


async def raw(run: Run, beside: Say = lambda _: None) -> None:
    """Packets as no library of ours stamps them: ahead, between ticks, with numbers that never come."""
    keys = Keys(run.directory.name)
    async with connect_ua(run.directory, "raw") as program:
        with run.join(node_identity("raw")) as session:

            def say(number: int) -> None:
                beside(number)
                for part in range(2):
                    seq = 2 * number + part + number // 5
                    at_ns = program.sim_time_ns + part * TICK_NS // 3 + number % 10 // 5 * 3 * TICK_NS
                    key, stamp = keys.tx("raw", "test"), Stamp(seq, at_ns).to_bytes()
                    session.put_bytes(key, bytes(150), attachment=stamp, must_arrive=True)

            await each_tick(program, say)


def once_all_said(ticks: int, programs: int, do: Callable[[], object]) -> Say:
    """What programs have beside them that something may be done once, when each has said so much."""
    said: Counter[int] = Counter()

    def beside(number: int) -> None:
        said[number] += 1
        if (number, said[number]) == (ticks, programs):
            do()

    return beside


def talk(*programs: Awaitable[None]) -> None:
    """Let programs be beside a run until it is over."""

    async def together() -> None:
        await asyncio.wait_for(asyncio.gather(*programs), 60.0)

    asyncio.run(together())


def is_the_same_again(run: Run, tmp_path: Path, slot: int) -> dict[str, Any]:
    """Fly it again; gives what `refly` says."""
    done = refly(run.directory, tmp_path, slot, "--json")
    assert done.returncode == 0, done.stdout + done.stderr
    content: dict[str, Any] = json.loads(done.stdout)
    return content


@pytest.mark.slow
@pytest.mark.parametrize("processes", ["one", MANY])
@pytest.mark.parametrize("medium", ["csma", pytest.param("ideal", marks=pytest.mark.long)])
@pytest.mark.parametrize("lookahead_ticks", [0, pytest.param(1, marks=pytest.mark.long)])
def test_what_free_programs_transmitted_is_repeated(
    start_run: StartRun,
    medium: str,
    processes: str,
    lookahead_ticks: int,
    tmp_path: Path,
    free_slot: Callable[[int], int],
) -> None:
    run = flies(start_run, medium, processes, enough=ENOUGH, lookahead_ticks=lookahead_ticks)
    talk(probe(run), pilot(run), raw(run))
    assert run.finish() == 0, run.output.decode()
    flown = load_run(run.directory).packets
    free = flown[flown.tx.astype(str).isin(("1", "probe", "raw"))]
    assert (free.groupby("tx", observed=True).seq.max() > 30).all()
    assert {"delivered", "too_long", "transport"} <= set(free.fate)
    assert (flown.channel == "answer").sum() > 100
    if medium == "csma":
        assert {"replaced", "expired"} <= set(free.fate)
    content = is_the_same_again(run, tmp_path, free_slot(2))
    assert content["difference"] is None
    nodes = {f"node {node}" for node in ("1", "probe", "raw")}
    told = [line for line in content["remarks"] if line.startswith("note: what a program transmitted as")]
    assert {node for node in nodes for line in told if f"as {node} is taken from the record" in line} == nodes
    assert not [line for line in content["remarks"] if "not repeat" in line]
    assert content["summary"]["digests"] == run.summary["digests"]
    assert content["summary"]["may_not_repeat"] == []


@pytest.mark.slow
@pytest.mark.parametrize("processes", [pytest.param("one", marks=pytest.mark.long), "many"])
@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGKILL, marks=pytest.mark.long)])
def test_a_run_that_was_cut_off_is_repeated_up_to_there(
    start_run: StartRun,
    number: signal.Signals,
    processes: str,
    tmp_path: Path,
    free_slot: Callable[[int], int],
) -> None:
    run = flies(start_run, "csma", processes)

    def end() -> None:
        children = run.children() if number == signal.SIGKILL else []
        for each in (psutil.Process(run.process.pid), *children):
            each.send_signal(number)

    beside = once_all_said(40, 3, end)
    talk(probe(run, beside), pilot(run, beside), raw(run, beside))
    run.finish()
    content = is_the_same_again(run, tmp_path, free_slot(2))
    assert content["difference"] is None
    assert content["compared_until_ns"] > TICK_NS * 20


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("processes", ["one", "many"])
def test_a_run_that_a_free_program_broke_off_is_repeated_up_to_there(
    start_run: StartRun, processes: str, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    run, both = flies(start_run, "csma", processes), asyncio.Event()
    beside = once_all_said(40, 2, both.set)

    async def fails() -> None:
        async with connect_ua(run.directory, 1, is_sender=True) as program:

            def say(number: int) -> None:
                beside(number)
                program.transmit("test", bytes(100))
                if both.is_set():
                    raise ZeroDivisionError

            with suppress(ZeroDivisionError):
                await each_tick(program, say)

    talk(probe(run, beside), fails())
    assert run.finish() == 1, run.output.decode()
    content = is_the_same_again(run, tmp_path, free_slot(2))
    assert content["difference"] is None
    assert content["compared_until_ns"] > 20 * TICK_NS


@pytest.mark.slow
@pytest.mark.parametrize("processes", ["one", MANY])
def test_a_run_that_repeats_takes_nothing_from_programs(
    start_run: StartRun, processes: str, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    run = flies(start_run, "csma", processes, duration_s=6.0)
    talk(probe(run))
    assert run.finish() == 0, run.output.decode()
    out, slot = tmp_path / "again", free_slot(2)
    words = ("refly", run.directory, "--out", out, "--first-slot", str(slot), "--speed", "1")
    again = Run(out, Command(*words, stdout=-1, stderr=-2, start_new_session=True), slot)
    again.wait_for("sim time")

    async def join() -> None:
        async with connect_ua(again.directory, "probe", is_sender=True):
            raise AssertionError

    with pytest.raises(
        PermissionError, match="this run repeats a record: what is transmitted as node probe is"
    ):
        asyncio.run(join())
    with again.join(node_identity("probe")) as session:
        key = Keys(again.directory.name).tx("probe", "test")
        session.put_bytes(key, b"mine", attachment=Stamp(10_000, 0).to_bytes(), must_arrive=True)
        assert again.finish() == 0, again.output.decode()
    assert b"identical" in again.output
    assert again.summary["refused"] == {"repeats_a_record": 1}
