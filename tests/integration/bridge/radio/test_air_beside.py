"""What a program beside a run learns of its node's radio: what waits in the queue, and what became of its unicasts."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import pandas as pd
import pytest

from bridge.agents import connect_ua
from bridge.agents.client import UaClient
from bridge.agents.radio import UnicastReply
from lostlink import load_run
from lostlink.redecision.redecide import redecide
from tests.integration.bridge.conftest import StartRun
from tests.integration.bridge.radio.test_air import FLAT, RADIO, node, rows, told

TICK_NS = 50_000_000
CSMA = {
    "preset": "disk",
    "max_range_m": 500.0,
    "frequency_hz": 2.4e9,
    "medium": {"model": "csma", "standard": "11b", "rate_mbps": 1.0},
}
"""802.11b at 1 Mb/s: a packet of 1400 bytes takes 192 us and 8 us for each of its 1436 bytes, 11.7 ms."""
SIFS_NS, ACK_NS = 10_000, 192_000 + 14 * 8_000
PROBE = {"id": "probe", "kind": "ground", "place": {"north_m": 100.0}, "agent": {"type": "free"}}
MESH = (0, None, "", "mesh")


def scenario(nodes: list[dict[str, Any]], **more: Any) -> str:
    content = {
        "schema": 1,
        "name": "beside",
        "speed": "SPEED",
        "duration_s": "DURATION",
        "origin": {"lat_deg": 37.0, "lon_deg": 127.0, "alt_amsl_m": 50.0},
        "fdm": {"standin_rate_hz": 100},
        "transmit": FLAT,
        "ports": {"zenoh": 0, "first_slot": "SLOT"},
        "radio": CSMA,
        "nodes": nodes,
    }
    text = json.dumps(content | more).replace("{", "{{").replace("}", "}}")
    for name in ("speed", "duration_s", "slot"):
        text = text.replace(f'"{name.partition("_")[0].upper()}"', f"{{{name}}}")
    return text


class Told:
    """Keeps what a program beside the run learns, tick by tick."""

    def __init__(self, ua: UaClient) -> None:
        self._ua = ua
        self.ticks: list[float] = []
        self.queues: dict[str, list[tuple[float, int, int]]] = {name: [] for name in ua.radios}
        self.replies: list[tuple[float, str, UnicastReply]] = []
        for name, radio in ua.radios.items():
            radio.on_reply(lambda reply, name=name: self.replies.append((ua.sim_time_ns / 1e9, name, reply)))
        ua.on_tick(self._ticked)

    def _ticked(self, now_ns: int) -> None:
        self.ticks.append(now_ns / 1e9)
        for name, radio in self._ua.radios.items():
            self.queues[name].append((now_ns / 1e9, *radio.queue))


@pytest.mark.slow
@pytest.mark.parametrize("processes", ["one", pytest.param("many", marks=pytest.mark.long)])
def test_a_script_beside_a_node_is_told_what_its_agent_is_told_at_the_same_ticks(
    start_run: StartRun, processes: str
) -> None:
    """Bursts of unicasts to a node in range and to one out of range, on two networks."""
    sends: list[tuple[Any, ...]] = []
    for tenth in range(10, 70, 5):
        sends += [(tenth / 10, "0", 1400)] * 8
        sends += [(tenth / 10, "g2", 100), *[(tenth / 10, "0", 100, *MESH)] * 10]
    nodes = [node(0, 0.0), node(1, 100.0, sends=sends), node(2, 5000.0)]
    mesh = RADIO | {"medium": {"model": "airtime"}}
    text = scenario(nodes, networks={"mesh": mesh})
    run = start_run(scenario=text, duration_s=7.5, speed="2", processes=processes)
    run.wait_for("sim time")

    async def listen() -> Told:
        async with connect_ua(run.directory, "g1") as one:
            heard, enough = Told(one), asyncio.Event()
            one.on_tick(lambda now_ns: now_ns >= 7_000_000_000 and enough.set())
            await asyncio.wait_for(enough.wait(), 60.0)
            return heard

    beside = asyncio.run(listen())
    assert run.finish() == 0, run.output.decode()
    flown = load_run(run.directory)
    first = beside.ticks[1]  # of the tick at which it joined it may not have all
    for name, file in (("main", "queue"), ("mesh", "queue-mesh")):
        board = [
            (each["sim_time_s"], each["packets"], each["length_bytes"]) for each in told(flown, "g1", file)
        ]
        mine = [each for each in beside.queues[name] if each[0] >= first]
        assert mine == [each for each in board if first <= each[0] <= mine[-1][0]]
        assert max(packets for _, packets, _ in mine) > 2
        assert mine[-1][1] == 0
    keys = ("seq", "acknowledged", "attempts", "at_ns")
    replies = [
        (each["sim_time_s"], each["radio"], *(each[key] for key in keys))
        for each in told(flown, "g1", "replies")
    ]
    mine = [(at_s, name, *reply) for at_s, name, reply in beside.replies if at_s >= first]
    assert mine == [each for each in replies if first <= each[0] <= beside.ticks[-1]]
    assert {(name, acknowledged) for _, name, _, acknowledged, *_ in mine} == {
        ("main", True),
        ("main", False),
    }
    assert len(mine) > 20


@pytest.mark.slow
@pytest.mark.parametrize("processes", ["one", pytest.param("many", marks=pytest.mark.long)])
def test_a_free_program_sees_its_queue_and_what_became_of_its_unicasts(
    start_run: StartRun, processes: str
) -> None:
    """Twenty long packets are before those with a key, which wait 0.2 s behind them."""
    run = start_run(
        scenario=scenario([node(0, 0.0), node(2, 5000.0), PROBE]),
        duration_s=8.0,
        speed="2",
        processes=processes,
    )
    run.wait_for("sim time")

    async def talk() -> tuple[Told, int, bool]:
        async with connect_ua(run.directory, "probe", is_sender=True) as probe:
            heard, replied = Told(probe), asyncio.Event()
            probe.radio.on_reply(lambda reply: reply.seq == last and replied.set())
            first = probe.transmit("test", bytes(1400), to="0")
            for _ in range(19):
                probe.transmit("test", bytes(1400), to="0")
            for n in range(3):
                probe.transmit("test", bytes(100 + n), to="0", key="state")
            last = probe.transmit("test", bytes(100), to="g2")
            await asyncio.wait_for(replied.wait(), 30.0)
            drained = asyncio.Event()
            probe.on_tick(lambda _: probe.radio.queue.packets or drained.set())
            await asyncio.wait_for(drained.wait(), 30.0)
            return heard, first, probe.is_over

    heard, first, is_over = asyncio.run(talk())
    assert not is_over
    assert run.finish() == 0, run.output.decode()
    flown = load_run(run.directory)
    near, far = rows(flown, "probe", "0"), rows(flown, "probe", "g2")
    assert near.fate.tolist() == ["delivered"] * 20 + ["replaced"] * 2 + ["delivered"]
    assert [(row.fate, row.attempts) for row in far.itertuples()] == [("retries_exhausted", 7)]
    came = near[near.fate == "delivered"]
    replies = {reply.seq - first: (at_s, reply) for at_s, _, reply in heard.replies}
    assert sorted(replies) == list(range(24))
    for row in came.itertuples():
        at_s, reply = replies[row.seq - first]
        assert (reply.acknowledged, reply.attempts) == (True, row.attempts)
        # the acknowledgement begins SIFS after the end of the frame at the receiver, and takes the same way back
        way_ns = row.arrived_ns - row.ended_ns
        assert reply.at_ns == row.arrived_ns + SIFS_NS + ACK_NS + way_ns
        assert round(at_s * 1e9) == (reply.at_ns // TICK_NS + 1) * TICK_NS  # the first tick after it
    for seq in (20, 21):
        assert replies[seq][1][1:3] == (False, 0)  # never on the air
    assert replies[23][1][1:3] == (False, 7)
    ended_ns = {first + number: reply.at_ns for number, (_, reply) in replies.items()}
    queues = heard.queues["main"]
    assert queues == [
        (at_s, *waiting(pd.concat([near, far]), ended_ns, round(at_s * 1e9))) for at_s, *_ in queues
    ]
    assert max(packets for _, packets, _ in queues) > 10
    assert queues[-1][1:] == (0, 0)


@pytest.mark.slow
@pytest.mark.parametrize("processes", ["one", pytest.param("many", marks=pytest.mark.long)])
@pytest.mark.parametrize("kind", ["ua", "ground"])
def test_packets_of_free_programs_enter_at_their_node_s_phase_and_are_decided_alike_again(
    start_run: StartRun, kind: str, processes: str
) -> None:
    """Two that send at each tick, a few per cent of what the medium carries: they do not meet."""
    where = {"ua": "home", "ground": "place"}[kind]
    other = {"id": 1, "kind": kind, where: {"east_m": 100.0}, "agent": {"type": "free"}}
    transmit = FLAT | {"phase_s": "drawn"}
    run = start_run(
        scenario=scenario([node(0, 0.0), PROBE, other], transmit=transmit, seed=1),
        duration_s=8.0,
        speed="2",
        processes=processes,
    )
    run.wait_for("sim time")

    async def talk(name: str) -> None:
        async with connect_ua(run.directory, name, is_sender=True) as program:
            ticks = asyncio.Semaphore(0)
            program.on_tick(lambda _: ticks.release())
            for _ in range(40):
                await asyncio.wait_for(ticks.acquire(), 30.0)
                program.transmit("test", bytes(100))

    async def both() -> None:
        await asyncio.gather(talk("probe"), talk("1"))

    asyncio.run(both())
    assert run.finish() == 0, run.output.decode()
    flown = load_run(run.directory)
    sent = flown.packets[flown.packets.channel == "test"]
    phases = (sent.entered_ns - sent.sim_time_ns).groupby(sent.tx.astype(str)).agg(["min", "max"])
    assert (phases["min"] == phases["max"]).all()
    assert phases["min"].nunique() == 2
    assert ((phases["min"] > 0) & (phases["min"] < TICK_NS)).all()
    assert (sent.fate == "delivered").all()
    assert redecide(run.directory).comparison.is_same


@pytest.mark.slow
def test_two_programs_at_once_as_one_node_are_told_of(start_run: StartRun) -> None:
    run = start_run(scenario=scenario([node(0, 0.0), PROBE]), duration_s=8.0, speed="2", processes="one")
    run.wait_for("sim time")

    async def talk() -> None:
        one, two = (connect_ua(run.directory, "probe", is_sender=True) for _ in range(2))
        async with one as first, two as second:
            ticks = asyncio.Semaphore(0)
            second.on_tick(lambda _: ticks.release())
            for _ in range(10):
                await asyncio.wait_for(ticks.acquire(), 30.0)
                first.transmit("test", b"first")
                second.transmit("test", b"second")

    asyncio.run(talk())
    assert run.finish() == 0, run.output.decode()
    told = [event for event in load_run(run.directory).summary["events"] if event["kind"] == "agent_warning"]
    text = "a packet with a number that was used is refused: two programs transmit as it at once, or one repeats itself"
    assert [(event["node"], event["text"]) for event in told] == [("probe", text)]
    assert f"the agent of node probe: {text}" in run.output.decode()


def waiting(sent: pd.DataFrame, ended_ns: dict[int, int], at_ns: int) -> tuple[int, int]:
    """Packets and bytes that wait just before an instant: each leaves when the one before it is done with."""
    packets = length_bytes = 0
    done_ns = -1
    for row in sent.sort_values(["started_ns", "seq"]).itertuples():
        if row.started_ns < 0:  # replaced: it left when the newer one came
            left_ns = ended_ns[row.seq]
        else:
            left_ns, done_ns = max(row.entered_ns, done_ns), ended_ns[row.seq]
        if row.entered_ns < at_ns <= left_ns:
            packets += 1
            length_bytes += row.length_bytes
    return packets, length_bytes
