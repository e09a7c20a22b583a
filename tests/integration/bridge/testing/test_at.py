"""`flight.at(t)`: from then on a test reads all of the record up to t, however busy the machine is."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from bridge.record.names import streams_of
from bridge.record.streams import entries_of
from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.every import TABLES
from bridge.record.tables.routes import ROUTES
from bridge.scenario.file import parse_scenario
from lostlink.reading.run import Run
from lostlink.testing import flight as testing
from lostlink.testing.flight import Flights

COUNTING = """from time import monotonic

from bridge.host.hosted_node import HostedNode
from lostlink import Agent

begun_s, flush = monotonic(), HostedNode._flush_now_and_then


def late(node, *when):
    if monotonic() > begun_s + 2.5:
        flush(node, *when)


HostedNode._flush_now_and_then = late  # the host's first flush comes long after those of physics and radio


class Counting(Agent):
    async def fly(self):
        count = 0
        while True:
            self.log("count", count)
            count += 1
            await self.sleep(0.05)
"""
SCENARIO = """
schema: 1
name: counting
duration_s: 3600
mcap: {write: false}
origin: {lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690}
radio: {preset: wifi-2.4, routing: {model: static, routes: {"0": {gcs: "1"}}}}
nodes:
  - {id: 0, sensor: {rate_hz: 4}, agent: &counting {type: own, class: "counting.py:Counting", has_task: false}}
  - {id: 1, home: {east_m: 20}, agent: *counting}
  - {id: gcs, kind: ground, place: {north_m: -30}, agent: *counting}
  - {id: probe, kind: ground, agent: {type: free}}
  - {id: beacon, kind: emitter, place: {north_m: 300}, frequency_hz: 433.92e+6, power_dbm: 20}
"""
S = 1_000_000_000
FATE_NS = S
"""The longest that a packet waits here for its fate."""


@pytest.fixture
def busy() -> Iterator[None]:
    """The machine has more to do than it can."""
    with ExitStack() as ending:
        for _ in range(2):
            other = ending.enter_context(subprocess.Popen([sys.executable, "-c", "while True: pass"]))
            ending.callback(other.kill)
        yield


def up_to(run: Run, sim_time_ns: int) -> dict[str, list[str]]:
    """All rows and entries that the record has up to an instant, by table and stream."""
    found: dict[str, list[str]] = {}
    for table in TABLES:
        columns = run.columns(table.name)
        is_late = table in (DELIVERIES, ROUTES)
        rows = np.flatnonzero(columns[table.tick] <= sim_time_ns - (FATE_NS if is_late else 0))
        order = np.lexsort([columns[key][rows] for key in table.keys])
        values = [column[rows][order].tolist() for column in columns.values()]
        found[table.name] = [repr(row) for row in zip(*values, strict=True)]  # in which NaN is like NaN
    for stream in streams_of(run.path):
        entries = entries_of(stream.path(run.path))
        found[str(stream)] = [repr(entry) for entry in entries if entry.tick_ns <= sim_time_ns]
    return found


@pytest.mark.slow
@pytest.mark.usefixtures("busy")
@pytest.mark.parametrize("processes", ["one", "many"])
async def test_all_that_was_recorded_up_to_then_can_be_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, processes: str
) -> None:
    monkeypatch.setattr(testing, "LOOK_S", 0.001)  # as soon as it is said to be there
    (tmp_path / "counting.py").write_text(COUNTING, encoding="utf-8")
    scenario = parse_scenario(SCENARIO, "counting", folder=tmp_path)
    flights, read = Flights(tmp_path / "runs"), dict[int, dict[str, list[str]]]()
    try:
        flight = await flights(scenario, changes={"processes": processes})
        for seconds in (1, 10):
            await flight.at(seconds)
            read[seconds] = up_to(flight.record, seconds * S)
    finally:
        flights.stop()
    for seconds, before in read.items():
        after = up_to(flight.record, seconds * S)
        assert before.keys() == after.keys()
        short = {name: (len(before[name]), len(after[name])) for name in after if before[name] != after[name]}
        assert short == {}, f"at {seconds} s"
        assert before["measurements"]
        assert before["routes"]
        assert len(before["logged/gcs"]) == 20 * seconds + 1
