"""What a scenario asks for is seen in the record of its run."""

from __future__ import annotations

import signal
import socket
from itertools import pairwise
from pathlib import Path

import pytest

from bridge.bus.keys import Keys
from bridge.bus.session import open_client
from bridge.radio.deliveries import DeliveryRow, read_deliveries
from bridge.record import names
from bridge.record.streams import read_stream
from channel.link.radio import Radio
from channel.presets import radio_from_mapping
from tests.integration.bridge.conftest import STILL, Run, StartRun

FADING = {
    "preset": "corrected",
    "frequency_hz": 100.0e6,
    "shadowing": {"model": "none"},
    "fading": {"model": "rayleigh", "coherence": "block"},
}
MOVING = STILL.replace(
    "radio: moon2020",
    "radio: {{preset: corrected, frequency_hz: 100.0e+6, shadowing: {{model: none}}, "
    "fading: {{model: rayleigh, coherence: block}}}}",
).replace(
    "home: {{north_m: 410}}, agent: {{type: still}}",
    "home: {{north_m: 50}}, agent: {{type: out_and_back, altitude_m: 20, distance_m: 120, speed_mps: 12}}",
)


def rows_of(run: Run) -> list[DeliveryRow]:
    return [row for row in read_deliveries(run.directory / "deliveries.csv") if row.tx == "0"]


def test_fading_changes_faster_when_the_ua_move(start_run: StartRun) -> None:
    """The oracle is the free-space-like mean power at the written distance: what is left is fading alone."""
    run = start_run(scenario=MOVING, duration_s=60.0)
    assert run.finish() == 0, run.output.decode()
    radio = Radio(radio_from_mapping(FADING))
    rows = rows_of(run)
    fading_db = [
        row.received_power_dbm - float(radio.link(row.distance_m).received_power_dbm) for row in rows
    ]
    new = {"standing": [0, 0], "moving": [0, 0]}
    for (before, after), (was_db, is_db) in zip(pairwise(rows), pairwise(fading_db), strict=True):
        speed_mps = abs(after.distance_m - before.distance_m) / 0.05
        kind = "standing" if speed_mps < 0.05 else "moving" if speed_mps > 6.0 else None
        if kind is not None:
            new[kind][0] += abs(is_db - was_db) > 0.01
            new[kind][1] += 1
    standing, moving = (changed / total for changed, total in new.values())
    assert new["moving"][1] > 100
    assert standing < 0.2  # half-second blocks: one packet in ten sees a new one
    assert moving > 0.6  # a block is an eighth of a second or less


BABBLER = """\
from bridge.agents import Agent

class Babbler(Agent):
    async def fly(self):
        for n in range(20):
            self.ua.transmit("team", b"no data package")
            await self.sleep(0.1)
"""
READER = """\
from bridge.agents import Agent

class Reader(Agent):
    def on_tick(self, sim_time_ns):
        super().on_tick(sim_time_ns)
        assert "1" not in self.latest or self.latest["1"].header.frame_id == "1"
        assert self.ua.comm_status is None or self.ua.comm_status.node == ("1",)
"""


def test_what_could_not_be_read_is_told_in_the_summary(start_run: StartRun, tmp_path: Path) -> None:
    (tmp_path / "babbler.py").write_text(BABBLER)
    (tmp_path / "reader.py").write_text(READER)
    babbler, reader = (
        f"{{{{type: own, class: {tmp_path}/{name.lower()}.py:{name}}}}}" for name in ("Babbler", "Reader")
    )
    head, _, tail = STILL.replace("{{type: still}}", reader, 1).rpartition("{{type: still}}")
    run = start_run(
        scenario=f"{head}{babbler}{tail}".replace("moon2020", "perfect"), duration_s=10.0, speed="4"
    )
    run.wait_for("sim time")
    with open_client(run.endpoint) as session:
        keys = Keys(run.directory.name)
        session.put_bytes(keys.rx("0", "1", "team"), b"without a stamp", must_arrive=True)
        session.put_bytes(keys.clock_exchange, b"garbage", must_arrive=True)
        assert run.finish() == 0, run.output.decode()
    counters = run.summary["counters"]
    assert counters["ua-0"]["packets_the_agent_could_not_read"] == 20
    assert counters["ua-0"]["packets_without_stamp"] == 1
    assert {c["malformed_samples"] for name, c in counters.items() if name.startswith("host-")} == {1}


def test_an_autopilot_that_is_gone_is_told_as_a_reason_why_the_run_may_not_repeat(
    start_run: StartRun,
) -> None:
    scenario = STILL.replace("radio:", "fdm: {{stall_timeout_s: 1}}\nradio:")
    run = start_run(scenario=scenario, duration_s=25.0, speed="2")
    run.wait_for("sim time")
    autopilot = run.child("bridge.standin --sysid 2")
    autopilot.send_signal(signal.SIGSTOP)
    run.wait_for("stalled: UA 1")
    autopilot.send_signal(signal.SIGCONT)
    assert run.finish() == 0, run.output.decode()
    summary = run.summary
    kinds = [event["kind"] for event in summary["events"] if event["node"] == "1"]
    assert kinds[:3] == ["joined", "stalled", "returned"]
    assert any("UA 1 was let go" in reason for reason in summary["may_not_repeat"])
    assert b"may not repeat: UA 1 was let go" in run.output


@pytest.mark.parametrize("hosts", ["1", "per-ua"])
def test_logs_tell_whose_they_are(start_run: StartRun, hosts: str) -> None:
    run = start_run(scenario=STILL.replace("radio:", f"hosts: {hosts}\nradio:"), duration_s=1.0)
    assert run.finish() == 0, run.output.decode()
    logs = {file.stem: file.read_text() for file in (run.directory / "logs").glob("host-*.log")}
    assert len(logs) == (1 if hosts == "1" else 2)
    text = "\n".join(logs.values())
    for node in ("0", "1"):
        assert f"INFO UA {node} agent: done at" in text
        assert f"INFO UA {node} aps.vehicle.vehicle: autopilot of system {int(node) + 1} heard" in text


def test_an_aircraft_bridge_that_cannot_go_on_ends_the_run_by_name(start_run: StartRun) -> None:
    run = start_run(speed="2")
    run.wait_for("sim time")
    (run.directory / "inputs").write_text("a file where inputs are to be written")
    with socket.create_connection(("127.0.0.1", 6760 + 10 * (run.slot + 1))):
        assert run.finish() == 1
    assert "UA 1 failed: its aircraft bridge cannot go on" in run.output.decode()
    assert run.summary["ending"] == "failed"


def test_a_killed_run_leaves_all_but_its_last_second(start_run: StartRun) -> None:
    run = start_run(speed="2")
    run.wait_for("sim time   1")  # 10 s to 19 s
    processes = run.children()
    run.process.kill()
    for process in processes:
        process.wait(10.0)
    for name in (names.truth("0"), names.from_autopilot("1"), names.packets("0")):
        entries = list(read_stream(name.path(run.directory)))
        assert entries[-1].tick_ns > 8_000_000_000


def test_a_model_outside_its_validity_ends_the_run_by_name(start_run: StartRun) -> None:
    hata = "{{preset: corrected, propagation: {{model: okumura-hata}}}}"
    run = start_run(scenario=STILL.replace("radio: moon2020", f"radio: {hata}"), duration_s=5.0)
    assert run.finish() != 0
    said = run.output.decode()
    assert (
        "frequency_hz = 2412000000.0: allowed is 1.5e+08 to 1.5e+09, the validity range of okumura-hata"
        in said
    )
    assert "Traceback" not in said
