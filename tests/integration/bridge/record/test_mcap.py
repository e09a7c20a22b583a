"""A real run as MCAP: read back by its schemas alone, by two readers that know nothing of ours."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader

from lostlink import RunResult, fly
from tests.integration.bridge.conftest import STILL
from tests.unit.lostlink.export.mcap.files import Read, read_mcap
from tests.warm import run_lostlink

AGENT = """\
import math
from lostlink import Agent


class Logger(Agent):
    async def fly(self):
        self.ua.report("looks around")
        async for now_s in self.every(0.5):
            self.log("error_m", 1 if now_s == 0.0 else self.rng.normal())
            self.log("leg", {"number": int(now_s * 2), "to_m": [1.0, now_s], "why": "because", "Late": now_s > 1})
            self.log("2nd-try", now_s > 1)
            self.log("phase", f"é {now_s}")
            self.log("gap_m", math.nan)
            for _ in range(3):
                self.ua.transmit("beacon", bytes(100), to="1" if self.ua.node == "0" else "all")
            if now_s >= 2.0:
                return

    def on_tick(self, sim_time_ns):
        if sim_time_ns == 500_000_000 and self.ua.node == "0":
            self.ua.transmit("large", bytes(3000))
"""


@pytest.fixture
def scenario(tmp_path: Path, free_slot: Callable[[int], int]) -> dict[str, Any]:
    (tmp_path / "logger.py").write_text(AGENT)
    text = STILL.replace("{{type: still}}", f'{{{{type: own, class: "{tmp_path}/logger.py:Logger"}}}}')
    content: dict[str, Any] = yaml.safe_load(text.format(speed="max", duration_s=20.0, slot=free_slot(2)))
    ground = {"kind": "ground", "id": "gcs-1", "place": {"north_m": 100}, "agent": {"type": "still"}}
    beacon = {"kind": "emitter", "id": "beacon", "frequency_hz": 433.92e6, "power_dbm": 20.0}
    content["nodes"] += [ground, beacon | {"place": {"north_m": 300}}]
    content["nodes"][1]["sensor"] = {"rate_hz": 5}
    return content | {"radio": {"preset": "corrected", "mtu_bytes": 2000}}


@pytest.mark.slow
def test_every_topic_decodes_and_counts_are_those_of_the_summary(
    tmp_path: Path, scenario: dict[str, Any]
) -> None:
    result = fly(scenario, directory=tmp_path / "runs")
    assert (result.ending, result.error) == ("done", None)
    read = read_mcap(result.path / "run.mcap")
    assert read.counts == read.statistics
    for topics in (_tables, _measurements, _radio, _agents, _mavlink, _texts):
        topics(read, result)
    _rosbags(read, result.path / "run.mcap")
    _export(result, read)
    _digests_do_not_depend_on_it(tmp_path, scenario, result)


def _tables(read: Read, result: RunResult) -> None:
    run = result.run
    ticks = run.truth.tick_ns.unique()
    assert len(read.messages["/clock"]) == len(ticks)
    assert read.times_ns["/clock"] == ticks.tolist()
    for node, topic in (("0", "/ua_0"), ("1", "/ua_1"), ("gcs-1", "/ground_gcs_1")):
        truth, states = (table[table.node == node] for table in (run.truth, run.states))
        assert read.times_ns[f"{topic}/truth"] == [t for t in truth.tick_ns if t % 200_000_000 == 0]
        assert read.times_ns[f"{topic}/state"] == [t for t in states.tick_ns if t % 200_000_000 == 0]
        assert read.times_ns[f"{topic}/pose"] == [t for t in truth.tick_ns if t % 100_000_000 == 0]
        last = truth[truth.tick_ns == read.times_ns[f"{topic}/truth"][-1]].iloc[0]
        message = read.messages[f"{topic}/truth"][-1]
        assert message.header.frame_id == node
        assert message.position_ned_m.x == pytest.approx(last.position_north_m, abs=1e-4)
        assert message.latitude_deg == pytest.approx(last.latitude_deg, abs=1e-9)
        assert message.specific_force_frd_mps2.z == pytest.approx(last.specific_force_down_mps2, abs=1e-3)
        fix = read.messages[f"{topic}/fix"][-1]
        assert fix.longitude == pytest.approx(last.longitude_deg, abs=1e-9)
        pose = read.messages[f"{topic}/pose"][-1]
        assert pose.pose.position.y == pytest.approx(truth.position_north_m.iloc[-1], abs=1e-2)
        state = read.messages[f"{topic}/state"][-1]
        assert state.mode == states["mode"].iloc[-1]
    frames = {each.transforms[0].child_frame_id for each in read.messages["/tf"]}
    assert frames == {"ua_0", "ua_1", "ground_gcs_1", "ground_beacon"}


def _measurements(read: Read, result: RunResult) -> None:
    table = result.run.measurements
    reported = table[table.outcome == "measured"]
    assert len(reported) == len(table) > 5
    messages = read.messages["/ua_1/measurements"]
    assert read.times_ns["/ua_1/measurements"] == reported.sim_time_ns.tolist()
    assert [list(message.number) for message in messages] == [[number] for number in reported.number]
    assert [list(message.power_dbm) for message in messages] == [[power] for power in reported.power_dbm]
    assert {(*message.emitter, *message.frequency_hz) for message in messages} == {("beacon", 433.92e6)}


def _radio(read: Read, result: RunResult) -> None:
    """Counts of fates are those of the summary, by link and cause; so are the last Links."""
    found: Counter[tuple[str, str, str]] = Counter()
    for fates in read.messages["/fates"]:
        for tx, rx, fate, packets in zip(fates.tx, fates.rx, fates.fate, fates.packets, strict=True):
            found[fates.node[tx], fates.node[rx], fates.cause[fate]] += packets
    expected: Counter[tuple[str, str, str]] = Counter()
    for link in result.summary["links"]:
        expected[link["tx"], link["rx"], "delivered"] = link["delivered"]
        for cause, count in link["lost"].items():
            expected[link["tx"], link["rx"], cause] = count
    assert +found == +expected
    assert expected["0", "1", "too_long"] == 1  # lost before the channel, and there all the same
    assert expected["0", "gcs-1", "too_long"] == 1
    links = read.messages["/links"][-1]
    totals = {
        (links.node[tx], links.node[rx]): (sent, delivered)
        for tx, rx, sent, delivered in zip(links.tx, links.rx, links.sent, links.delivered, strict=True)
    }
    assert totals == {
        (link["tx"], link["rx"]): (link["sent"], link["delivered"]) for link in result.summary["links"]
    }
    matrix = read.messages["/communication"][-1]
    assert len(matrix.known) == len(matrix.delivered) == 9
    assert not any(matrix.known[i * 4] for i in range(3))
    sent = {node: list(result.run.transmitted(node)) for node in ("0", "1", "gcs-1")}
    for node, topic in (("0", "/ua_0"), ("1", "/ua_1"), ("gcs-1", "/ground_gcs_1")):
        packets = read.messages[f"{topic}/packets"]
        assert [(p.seq, p.address, p.length_bytes) for p in packets] == [
            (p.seq, p.address, len(p.payload)) for p in sent[node]
        ]
        assert all(len(packet.payload) == 0 for packet in packets)


def _agents(read: Read, result: RunResult) -> None:
    data = result.run.agent_data
    for node, topic in (("0", "/ua_0"), ("1", "/ua_1")):
        errors = [message.value for message in read.messages[f"{topic}/log/error_m"]]
        assert errors == data[(data.node == node) & (data.name == "error_m")].value.tolist()
        leg = read.messages[f"{topic}/log/leg"][3]
        assert (leg.number, list(leg.to_m), leg.why, leg.late) == (3, [1.0, 1.5], "because", True)
        assert [m.value for m in read.messages[f"{topic}/log/v_2nd_try"]] == [False, False, False, True, True]
        assert read.messages[f"{topic}/log/phase"][1].value == "é 0.5"
        assert math.isnan(read.messages[f"{topic}/log/gap_m"][0].value)
        assert [m.activity for m in read.messages[f"{topic}/agent"]] == ["looks around", "is done"]
    assert read.schemas["/ua_0/log/leg"] == read.schemas["/ua_1/log/leg"] == "lostlink_logged/msg/Leg"


def _mavlink(read: Read, result: RunResult) -> None:
    for node in ("0", "1"):
        for direction in ("from_autopilot", "to_autopilot"):
            recorded = b"".join(entry.payload for entry in result.run.mavlink(node, direction))  # type: ignore[arg-type]
            messages = read.messages[f"/ua_{node}/mavlink/{direction}"]
            assert b"".join(bytes(message.data) for message in messages) == recorded


def _texts(read: Read, result: RunResult) -> None:
    events = read.messages["/events"]
    assert [(e.name, e.msg, e.file) for e in events] == [
        (e["kind"], e["text"], e["node"]) for e in result.summary["events"]
    ]
    heard = [m for m in read.messages["/rosout"] if "autopilot of system 1 heard" in m.msg]
    assert [(m.name, m.level) for m in heard] == [("node-0.aps.vehicle.vehicle", 20)]
    assert 0 < heard[0].stamp.nanosec < 1_000_000_000
    assert read.metadata["run"] == result.path.name
    assert json.loads(read.metadata["summary"])["digest"] == result.summary["digest"]
    assert yaml.safe_load(read.metadata["scenario"])["name"] == "still"


def _rosbags(read: Read, path: Path) -> None:
    """The reader of rosbags, which takes it for a ROS 2 bag, decodes the same messages."""
    found: Counter[str] = Counter()
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            message: Any = reader.deserialize(raw, connection.msgtype)
            if connection.topic == "/ua_1/log/leg":
                same = read.messages[connection.topic][found[connection.topic]]
                assert (message.number, message.why) == (same.number, same.why)
                assert np.array_equal(message.to_m, same.to_m)
            found[connection.topic] += 1
    assert found == read.counts


def _export(result: RunResult, before: Read) -> None:
    """With options: payloads, decoded MAVLink, other rates, another compression."""
    options = (
        "--mcap --payloads --mavlink messages --rate truth=20 --rate fates=0 --rate log=1 --compression lz4"
    )
    options += " --size packets=2000"
    folder = result.path / "again"
    command = ["export", str(result.path), *options.split(), "--out", str(folder)]
    run_lostlink(*command, check=True)
    read = read_mcap(folder / "run.mcap")
    assert read.counts == read.statistics
    assert read.counts["/ua_0/truth"] == before.counts["/clock"]
    assert "/fates" not in read.counts
    assert read.times_ns["/ua_0/log/leg"] == [0, 1_000_000_000, 2_000_000_000]
    payloads = [bytes(message.payload) for message in read.messages["/ua_0/packets"]]
    sent = [packet.payload for packet in result.run.transmitted("0")]
    assert payloads == [payload for payload in sent if len(payload) < 2000]
    left_out = len(sent) - len(payloads)
    assert json.loads(read.metadata["left_out"]) == ({"/ua_0/packets": left_out} if left_out else {})
    heartbeats = read.messages["/ua_1/mavlink/from_autopilot/HEARTBEAT"]
    assert {message.sysid for message in heartbeats} == {2}
    attitudes = read.messages["/ua_1/mavlink/from_autopilot/ATTITUDE"]
    assert abs(attitudes[-1].pitch) < 0.1


def _digests_do_not_depend_on_it(tmp_path: Path, scenario: dict[str, Any], result: RunResult) -> None:
    without = fly(scenario, directory=tmp_path / "runs", changes={"mcap.write": False})
    assert not (without.path / "run.mcap").exists()
    assert without.summary["digests"] == result.summary["digests"]


@pytest.mark.slow
def test_a_killed_run_is_there_up_to_its_last_second(tmp_path: Path, scenario: dict[str, Any]) -> None:
    """What is left after SIGKILL of everything: journals and streams, which `lostlink export --mcap` reads."""
    script = (
        "import os, signal, sys, threading, yaml\nfrom lostlink.flight.shown.progress import Progress\n"
        "from lostlink import fly\n"
        "def message(self, m):\n"
        "    from bridge.bus.messages import Clock\n"
        "    if isinstance(m, Clock) and m.header.stamp.ns >= 6_000_000_000: os.kill(os.getpid(), signal.SIGKILL)\n"
        "Progress.on_message = message\n"
        "fly(yaml.safe_load(sys.argv[1]), speed=2.0, directory=sys.argv[2], quiet=False)\n"
    )
    scenario["nodes"][1]["agent"] = {"type": "still"}
    text = AGENT.replace("if now_s >= 2.0:", "if now_s >= 60.0:")
    (tmp_path / "logger.py").write_text(text)
    command = [sys.executable, "-c", script, yaml.safe_dump(scenario), str(tmp_path / "runs")]
    done = subprocess.run(command, capture_output=True, timeout=280, check=False)
    assert done.returncode == -9
    (run,) = (tmp_path / "runs").iterdir()
    assert not (run / "summary.json").exists()
    assert (run / "truth.journal").exists()
    run_lostlink("export", str(run), "--mcap", check=True)
    read = read_mcap(run / "run.mcap")
    earliest_ns = 6_000_000_000 - 2 * 2 * 1_000_000_000  # two seconds of wall time at speed 2
    for topic in (
        "/clock",
        "/ua_0/pose",
        "/ua_1/state",
        "/fates",
        "/ua_0/log/error_m",
        "/ua_0/mavlink/from_autopilot",
    ):
        assert read.times_ns[topic][-1] >= earliest_ns, topic
    assert (run / "truth.journal").exists()
