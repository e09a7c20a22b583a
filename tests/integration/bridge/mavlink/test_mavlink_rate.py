"""MAVLink between ticks: a ground station at real time feels no lag, and the run repeats all the same."""

from __future__ import annotations

import json
import queue
import signal
from collections import Counter

import pyarrow.parquet as pq
import pytest
from pymavlink import mavutil

from bridge.bus.keys import Keys
from bridge.bus.messages import Header, decode
from bridge.bus.session import Sample
from bridge.record import names
from bridge.record.streams import read_stream
from tests.integration.bridge.conftest import STILL, StartRun
from tests.integration.bridge.mavlink.mission import mission_items, upload

QUICK = STILL.replace("radio:", "mavlink_rate_hz: 100\nradio:")


@pytest.mark.slow
def test_200_mission_items_are_uploaded_within_5_s(start_run: StartRun) -> None:
    """Of sim time, by a client that answers at once: at half the speed one that other tests hold up does, too."""
    run = start_run(scenario=QUICK, speed="0.5")
    run.wait_for("sim time")
    client = mavutil.mavlink_connection(f"tcp:127.0.0.1:{6760 + 10 * (run.slot + 1)}")
    client.recv_match(type="HEARTBEAT", condition="HEARTBEAT.type==2", blocking=True, timeout=20)
    upload(client, mission_items(200))
    client.close()
    run.stop(signal.SIGTERM)
    lines = [json.loads(line) for line in (run.directory / "inputs" / "1.jsonl").read_text().splitlines()]
    assert any(line["tick_ns"] % 50_000_000 for line in lines)
    items_ns = [line["tick_ns"] for line in lines if line.get("name") == "MISSION_ITEM_INT"]
    assert len(items_ns) >= 200
    assert items_ns[-1] - items_ns[0] < 5_000_000_000


@pytest.mark.parametrize("rate_hz", [20, pytest.param(100, marks=pytest.mark.slow)])
def test_ticks_are_those_of_the_tick_rate_at_any_mavlink_rate(start_run: StartRun, rate_hz: int) -> None:
    run = start_run(scenario=QUICK.replace("100", str(rate_hz), 1), duration_s=3.0)
    assert run.finish() == 0, run.output.decode()
    rows = pq.read_table(run.directory / "truth.parquet", filters=[("node", "=", "0")]).to_pylist()
    assert [row["tick_ns"] for row in rows] == [50_000_000 * n for n in range(61)]
    assert rows[-1]["sim_time_ns"] - 3_000_000_000 in range(2_500_000)
    exchanges = Counter(
        entry.tick_ns % (1_000_000_000 // rate_hz)
        for entry in read_stream(names.from_autopilot("0").path(run.directory))
    )
    assert set(exchanges) == {0}
    assert run.summary["links"][0]["sent"] == 61


@pytest.mark.parametrize("processes", ["one", pytest.param("many", marks=pytest.mark.slow)])
def test_observers_are_told_of_the_release_of_each_instant(start_run: StartRun, processes: str) -> None:
    run = start_run(scenario=QUICK, speed="4", duration_s=36000.0, processes=processes)
    run.wait_for("sim time")
    keys = Keys(run.directory.name)
    came: queue.SimpleQueue[tuple[str, int]] = queue.SimpleQueue()

    def keep(sample: Sample) -> None:
        came.put((str(sample.key_expr), decode(sample.payload.to_bytes(), Header).stamp.ns))

    with run.join("observer") as session:
        for key in (keys.clock_exchange, keys.clock_release):
            session.subscribe(key, keep)
        said = [came.get(timeout=20.0) for _ in range(300)]
    exchanges, releases = (
        {at_ns for key, at_ns in said[50:-50] if key == one}
        for one in (keys.clock_exchange, keys.clock_release)
    )
    assert len(exchanges) > 50
    assert exchanges <= {at_ns for key, at_ns in said if key == keys.clock_release}
    assert releases - exchanges
    run.stop(signal.SIGTERM)
