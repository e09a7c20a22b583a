"""What RF sensors reported is in a file as the run published it, and no more than that."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from bridge.record.tables.every import finish_tables
from bridge.record.tables.measurements import MeasurementWriter
from bridge.scenario.file import with_changes
from bridge.scenario.mcap import McapSettings
from channel.sensing.measured import BELOW_THRESHOLD, MEASURED, Measured
from lostlink.export.mcap.export import write_mcap
from lostlink.replay.player import Player
from tests.unit.lostlink.export.mcap.files import Read, read_mcap
from tests.unit.lostlink.replay.flown import TICK_NS, flown, scenario_of

PERIOD_NS = 5 * TICK_NS
TICKS = 121  # past the first window of 5 s
CARRIER_HZ = 433.92e6


def measured_at(number: int) -> Measured:
    """Sensors of "0" and gcs: the first hears both emitters, the louder first; gcs only one, above its threshold."""
    power_dbm = np.array([-60.5 - number, -70.0, -50.0, np.nan])
    return Measured(
        np.array([0, 0, 1, 1]),
        np.array([0, 1, 0, 1]),
        np.full(4, number),
        *[np.full(4, 100.0)] * 5,
        power_dbm,
        np.array([MEASURED, MEASURED, MEASURED, BELOW_THRESHOLD], dtype=np.uint8),
    )


@pytest.fixture(params=["finished", "killed"])
def run(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    scenario = with_changes(
        scenario_of("perfect", ("0", "1", "gcs"), emitters=("a", "b")),
        {"nodes.0.sensor": {"identifies": "none"}, "nodes.gcs.sensor": {}},
    )
    made = flown(tmp_path / "run", scenario, TICKS, killed=True)
    table = MeasurementWriter(made, ["0", "gcs"], ["a", "b"])
    for number in range(TICKS // 5 + 1):
        table.write(number * PERIOD_NS, measured_at(number))
    table.close()
    if request.param == "finished":
        finish_tables(made)
    return made


def exported(run: Path, **settings: object) -> Read:
    write_mcap(run, run / "run.mcap", McapSettings.model_validate(settings))
    return read_mcap(run / "run.mcap")


def test_measurements_are_there_as_the_sensors_reported_them(run: Path) -> None:
    read = exported(run)
    assert {t for t in read.counts if "measure" in t} == {"/ua_0/measurements", "/ground_gcs/measurements"}
    assert read.schemas["/ua_0/measurements"] == "lostlink_msgs/msg/Measurements"
    for topic in ("/ua_0/measurements", "/ground_gcs/measurements"):
        assert read.times_ns[topic] == [number * PERIOD_NS for number in range(25)]
    fifth, of_gcs = (read.messages[topic][5] for topic in ("/ua_0/measurements", "/ground_gcs/measurements"))
    assert (fifth.header.stamp.sec, fifth.header.stamp.nanosec) == (1, 250_000_000)
    assert (fifth.header.frame_id, list(fifth.node), list(fifth.number)) == ("0", [0, 0], [5, 5])
    assert (list(fifth.power_dbm), list(fifth.emitter)) == ([-70.0, -65.5], ["", ""])
    assert all(map(math.isnan, fifth.frequency_hz))
    assert (of_gcs.header.frame_id, list(of_gcs.node), list(of_gcs.number)) == ("gcs", [2], [5])
    assert (list(of_gcs.power_dbm), list(of_gcs.frequency_hz)) == ([-50.0], [CARRIER_HZ])
    assert list(of_gcs.emitter) == ["a"]


def test_they_are_those_of_a_replay(run: Path) -> None:
    read, topics = exported(run), {"0": "/ua_0/measurements", "gcs": "/ground_gcs/measurements"}
    played: dict[str, list[tuple[int, list[float], list[int]]]] = {node: [] for node in topics}
    for moment in Player.open(run).moments():
        for node, message in moment.measurements():
            played[node].append((message.header.stamp.ns, list(message.power_dbm), list(message.number)))
    for node, topic in topics.items():
        found = zip(read.times_ns[topic], read.messages[topic], strict=True)
        assert played[node] == [(at_ns, list(m.power_dbm), list(m.number)) for at_ns, m in found]


def test_their_rate_and_size_are_chosen_as_of_other_kinds(run: Path) -> None:
    assert exported(run, rates_hz={"measurements": 1.0}).counts["/ua_0/measurements"] == 7  # 0 s to 6 s
    assert "/ua_0/measurements" not in exported(run, rates_hz={"measurements": 0.0}).counts
    read = exported(run, sizes_bytes={"measurements": 100})  # two measurements take more, one does not
    assert ("/ua_0/measurements" in read.counts, read.counts["/ground_gcs/measurements"]) == (False, 25)
