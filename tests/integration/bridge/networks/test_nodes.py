"""Nodes of kinds in a run: on the ground, free-running, isolated; packets for one of them."""

from __future__ import annotations

import asyncio
import queue
from pathlib import Path
from typing import Any

import pytest

from bridge.agents import connect_ua
from bridge.bus.keys import Keys
from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.reader import read_columns
from bridge.record.tables.truth import TRUTH
from tests.integration.bridge.conftest import STILL, Run, StartRun

BASE = """\
from bridge.agents import Agent

class Base(Agent):
    async def fly(self):
        assert self.ua.state is not None and self.ua.state.mode == "GROUND"
        for n in range(20):
            self.ua.transmit("orders", b"to one", to="1")
            await self.sleep(0.1)
"""
TRACK = "[{{sim_time_s: 1, north_m: 10}}, {{sim_time_s: 2, north_m: 30, height_m: 4}}]"


def rows(run: Run, **wanted: str) -> list[dict[str, Any]]:
    table = read_columns(run.directory, DELIVERIES)
    found = (dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True))
    return [row for row in found if all(row[name] == value for name, value in wanted.items())]


@pytest.mark.slow
def test_a_ground_station_hears_and_sends_to_one(start_run: StartRun, tmp_path: Path) -> None:
    (tmp_path / "base.py").write_text(BASE)
    more = (
        "  - {{id: gcs, kind: ground, place: {{north_m: 200, height_m: 3}}, "
        f"agent: {{{{type: own, isolated: true, class: {tmp_path}/base.py:Base}}}}}}}}\n"
        f"  - {{{{id: van, kind: ground, track: {TRACK}, agent: {{{{type: still}}}}}}}}\n"
    )
    run = start_run(scenario=STILL.replace("moon2020", "perfect") + more, duration_s=5.0)
    assert run.finish() == 0, run.output.decode()
    orders = [row for row in rows(run, tx="gcs", rx="1") if row["length_bytes"] == len(b"to one")]
    assert len(orders) == 20
    assert {row["fate"] for row in orders} == {"delivered"}
    assert not [row for row in rows(run, tx="gcs", rx="0") if row["length_bytes"] == len(b"to one")]
    assert all(abs(row["distance_m"] - 200.0) < 0.1 for row in rows(run, tx="0", rx="gcs"))
    truth = read_columns(run.directory, TRUTH)
    van = truth["node"] == "van"
    at = {
        int(t): (n, d)
        for t, n, d in zip(
            truth["tick_ns"][van], truth["position_north_m"][van], truth["position_down_m"][van], strict=True
        )
    }
    assert at[0] == (10.0, -2.0)
    assert at[1_500_000_000] == (20.0, -3.0)
    assert max(at) < 3_000_000_000  # the base had a task, and is done with it
    assert run.summary["ending"] == "done"
    assert not run.summary["may_not_repeat"]
    assert (run.directory / "logs" / "host-of-gcs.log").exists()


@pytest.mark.slow
def test_a_free_program_transmits_beside_the_clock(start_run: StartRun) -> None:
    more = "  - {{id: probe, kind: ground, place: {{north_m: 50}}, agent: {{type: free}}}}\n"
    run = start_run(scenario=STILL.replace("moon2020", "perfect") + more, duration_s=16.0, speed="2")
    run.wait_for("sim time")

    async def talk() -> int:
        async with connect_ua(run.directory, "probe", is_sender=True) as probe:
            heard = asyncio.Event()
            probe.on_packet(lambda *_: heard.set())
            await asyncio.wait_for(heard.wait(), 30.0)
            for n in range(5):
                probe.transmit("chatter", bytes(n + 1))
            probe.transmit("chatter", b"one", to="0")
            return probe.sent

    async def talk_again() -> list[int]:
        async with connect_ua(run.directory, "probe", is_sender=True) as probe:
            probe.log("sent", probe.sent)
            return [probe.transmit("chatter", b"once more") for _ in range(3)]

    async def talk_as_another() -> None:
        async with connect_ua(run.directory, "1", is_sender=True):
            pass

    def wait_for_packets(count: int) -> None:
        """The radio has taken them: the next program begins where this one ended."""
        for _ in range(count):
            came.get(timeout=30.0)

    logged: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    came: queue.SimpleQueue[object] = queue.SimpleQueue()
    with run.join("observer") as observer:
        key = Keys(run.directory.name).logged("probe", "sent")
        observer.subscribe(key, lambda sample: logged.put(sample.payload.to_bytes()))
        observer.subscribe(Keys(run.directory.name).rx("0", "probe", "chatter"), came.put)
        assert asyncio.run(talk()) == 6
        wait_for_packets(6)
        assert asyncio.run(talk_again()) == [6, 7, 8]
        wait_for_packets(3)
        assert asyncio.run(talk_again()) == [9, 10, 11]
        assert [logged.get(timeout=10.0) for _ in range(2)] == [b"6", b"9"]
    with pytest.raises(PermissionError, match="node 1 has an agent that is not free, which alone transmits"):
        asyncio.run(talk_as_another())
    assert run.finish() == 0, run.output.decode()
    later = list(range(6, 12))
    assert [row["seq"] for row in rows(run, tx="probe", rx="1")] == [0, 1, 2, 3, 4, *later]
    assert [row["seq"] for row in rows(run, tx="probe", rx="0")] == [0, 1, 2, 3, 4, 5, *later]
    assert {row["fate"] for row in rows(run, tx="probe")} == {"delivered"}
    assert any("transmits as node probe" in reason for reason in run.summary["may_not_repeat"])


@pytest.mark.slow
@pytest.mark.parametrize("where", ["in a callback", "in flight"])
def test_what_a_free_program_raises_ends_the_run_by_name(start_run: StartRun, where: str) -> None:
    more = "  - {{id: probe, kind: ground, place: {{north_m: 50}}, agent: {{type: free}}}}\n"
    run = start_run(scenario=STILL.replace("moon2020", "perfect") + more, duration_s=60.0, speed="2")
    run.wait_for("sim time")

    def stumble(*_: object) -> None:
        raise KeyError("somebody's mistake")

    async def fly() -> None:
        async with connect_ua(run.directory, "probe", is_sender=True) as probe:
            if where == "in flight":
                stumble()
            probe.on_packet(stumble)
            await asyncio.to_thread(run.finish)

    if where == "in flight":
        with pytest.raises(KeyError, match="somebody's mistake"):
            asyncio.run(fly())
    else:
        asyncio.run(fly())
    assert run.finish() == 1
    assert f"the agent of node probe failed: KeyError {where}: " in run.output.decode()
    assert "somebody's mistake" in run.output.decode()


@pytest.mark.slow
def test_a_station_that_only_listens_and_observers_change_no_fate(start_run: StartRun) -> None:
    scenario = STILL.replace("moon2020", "corrected")
    alone = start_run(scenario=scenario, duration_s=8.0, speed="4")
    assert alone.finish() == 0, alone.output.decode()
    ear = "  - {{id: ear, kind: ground, place: {{north_m: 50}}, agent: {{type: free}}}}\n"
    heard = start_run(scenario=scenario + ear, duration_s=8.0, speed="4")
    heard.wait_for("sim time")
    keys: set[str] = set()
    with heard.join("observer") as observer:
        observer.subscribe(
            f"{Keys(heard.directory.name).prefix}/**", lambda sample: keys.add(str(sample.key_expr))
        )
        assert heard.finish() == 0, heard.output.decode()
    assert any("/tick/fates" in key for key in keys)
    assert any("/node/ear/rx/0/team" in key for key in keys)
    for tx, rx in (("0", "1"), ("1", "0")):
        assert rows(heard, tx=tx, rx=rx) == rows(alone, tx=tx, rx=rx) != []
    assert not heard.summary["may_not_repeat"]
    for part in ("mavlink/0/from_autopilot", "mavlink/1/to_autopilot", "packets/0"):
        assert heard.summary["digests"][part] == alone.summary["digests"][part]
