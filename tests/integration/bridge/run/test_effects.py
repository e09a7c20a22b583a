"""What a scenario asks for is seen in the record of its run."""

from __future__ import annotations

import hashlib
import signal
import socket
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow.parquet as pq
import pytest

from bridge.bus.keys import Keys
from bridge.record import names
from bridge.record.provenance import read_provenance
from bridge.record.streams import read_stream
from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.reader import read_columns
from bridge.record.tables.truth import TRUTH
from bridge.run.directory import RunDirectory
from channel.link.radio import Radio
from channel.presets import radio_from_mapping
from tests.integration.bridge.conftest import STILL, Run, StartRun
from tests.warm import run_lostlink

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


class Row(NamedTuple):
    distance_m: float
    received_power_dbm: float


def rows_of(run: Run) -> list[Row]:
    columns = ("tx", *Row._fields)
    return [
        Row(*numbers)
        for tx, *numbers in zip(*read_columns(run.directory, DELIVERIES, columns).values(), strict=True)
        if tx == "0"
    ]


@pytest.mark.slow
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


@pytest.mark.parametrize("rate_hz", [100, 800])
def test_the_stand_in_asks_for_as_many_frames_as_the_scenario_says(start_run: StartRun, rate_hz: int) -> None:
    run = start_run(scenario=f"{STILL}fdm: {{{{standin_rate_hz: {rate_hz}}}}}\n", duration_s=2.0)
    assert run.finish() == 0, run.output.decode()
    frames = [run.summary["counters"]["physics"][f"ua {ua} frames"] for ua in (0, 1)]
    assert frames == [pytest.approx(2.0 * rate_hz, abs=3)] * 2


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [100, pytest.param(2000, marks=[pytest.mark.slow, pytest.mark.long])])
def test_the_stand_in_holds_its_height_at_any_rate_of_frames(start_run: StartRun, rate_hz: int) -> None:
    hovering = STILL.replace("type: still", "type: hold, altitude_m: 20")
    run = start_run(scenario=f"{hovering}fdm: {{{{standin_rate_hz: {rate_hz}}}}}\n", duration_s=25.0)
    assert run.finish() == 0, run.output.decode()
    rows = pq.read_table(run.directory / "truth.parquet").to_pandas()
    late = rows[rows["tick_ns"] > 20e9]
    assert len(late) == 2 * 100
    assert late["position_down_m"].to_numpy() == pytest.approx(-20.0, abs=0.5)
    rates = late[[f"body_rate_{axis}_radps" for axis in ("forward", "right", "down")]].to_numpy()
    assert np.abs(rates).max() < 0.05


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
        scenario=f"{head}{babbler}{tail}".replace("moon2020", "perfect"),
        duration_s=10.0,
        speed="4",
        processes="many",
    )
    run.wait_for("sim time")
    with run.join("physics") as session:
        keys = Keys(run.directory.name)
        session.put_bytes(keys.clock_exchange, b"garbage", must_arrive=True)
        assert run.finish() == 0, run.output.decode()
    counters = run.summary["counters"]
    assert counters["node-0"]["messages_the_agent_could_not_read"] == 20
    assert {c["malformed_samples"] for name, c in counters.items() if name.startswith("host-")} == {1}


@pytest.mark.slow
def test_an_autopilot_that_is_gone_is_told_as_a_reason_why_the_run_may_not_repeat(
    start_run: StartRun,
) -> None:
    scenario = STILL.replace("radio:", "hosts: per-ua\nfdm: {{stall_timeout_s: 1}}\nradio:")
    run = start_run(scenario=scenario, duration_s=25.0, speed="2")
    run.wait_for("sim time")
    autopilot = run.child("standin --sysid 2")
    autopilot.send_signal(signal.SIGSTOP)
    run.wait_for("warning: UA 1: its autopilot does not answer")
    run.wait_for("stalled: UA 1")
    autopilot.send_signal(signal.SIGCONT)
    assert run.finish() == 0, run.output.decode()
    summary = run.summary
    kinds = [event["kind"] for event in summary["events"] if event["node"] == "1"]
    assert kinds[:3] == ["joined", "stalled", "returned"]
    assert any("UA 1 was let go" in reason for reason in summary["may_not_repeat"])
    assert b"may not repeat: UA 1 was let go" in run.output


@pytest.mark.parametrize("hosts", ["1", pytest.param("per-ua", marks=pytest.mark.slow)])
def test_logs_tell_whose_they_are(start_run: StartRun, hosts: str) -> None:
    run = start_run(scenario=STILL.replace("radio:", f"hosts: {hosts}\nradio:"), duration_s=1.0)
    assert run.finish() == 0, run.output.decode()
    assert len(list((run.directory / "logs").glob("host-*.log"))) == (1 if hosts == "1" else 2)
    for node in ("0", "1"):
        text = (run.directory / "logs" / f"node-{node}.log").read_text()
        assert "INFO agent: done at" in text
        assert f"INFO aps.vehicle.vehicle: autopilot of system {int(node) + 1} heard" in text
        ready = (run.directory / "logs" / f"autopilot-{node}.log").read_text()
        assert ready.startswith(f"ready: sysid {int(node) + 1}, ")
    assert (run.directory / "logs" / "autopilots-0.log").exists() == (hosts == "1")


@pytest.mark.slow
def test_an_aircraft_bridge_that_cannot_go_on_ends_the_run_by_name(start_run: StartRun) -> None:
    run = start_run(speed="2")
    run.wait_for("sim time")
    (run.directory / "inputs").write_text("a file where inputs are to be written")
    with socket.create_connection(("127.0.0.1", 6760 + 10 * (run.slot + 1))):
        assert run.finish() == 1
    assert "UA 1 failed: its aircraft bridge cannot go on" in run.output.decode()
    assert run.summary["ending"] == "failed"


@pytest.mark.slow
def test_a_killed_run_leaves_all_but_its_last_second(start_run: StartRun) -> None:
    run = start_run(speed="2")
    run.wait_for(" in the last ")  # the second line of progress, after ten seconds
    processes = run.children()
    run.process.kill()
    run.process.wait(10.0)  # else it is there still, as a zombie
    for process in processes:
        process.wait(10.0)
    for name in (names.from_autopilot("1"), names.packets("0")):
        entries = list(read_stream(name.path(run.directory)))
        assert entries[-1].tick_ns > 8_000_000_000
    ticks = read_columns(run.directory, TRUTH, ("tick_ns",))["tick_ns"]
    assert ticks[::2].tolist() == [50_000_000 * n for n in range(len(ticks[::2]))]
    assert ticks[-1] > 8_000_000_000
    assert not TRUTH.parquet_path(run.directory).exists()
    command = ["export", str(run.directory), "--csv", "--parquet"]
    run_lostlink(*command, check=True, timeout=60)
    lines = (run.directory / "deliveries.csv").read_text().splitlines()
    assert int(lines[-1].split(",")[0]) > 8_000_000_000
    assert pq.read_metadata(DELIVERIES.parquet_path(run.directory)).num_rows == len(lines) - 1


def test_tables_that_cannot_be_finished_break_the_run_off_and_its_summary_says_so(
    start_run: StartRun,
) -> None:
    run = start_run(duration_s=4.0, speed="2")
    run.wait_for("sim time")
    pid = RunDirectory(run.directory).info.pid
    (run.directory / f"truth.parquet.{pid}.partial").mkdir()
    assert run.finish() == 1
    assert run.summary["ending"] == "failed"
    assert "its tables could not be written as Parquet" in run.summary["error"]
    assert "deliveries" not in run.summary["digests"]
    assert TRUTH.journal_path(run.directory).exists()


def test_a_model_outside_its_validity_ends_the_run_by_name(start_run: StartRun) -> None:
    hata = "{{preset: corrected, frequency_hz: 915.0e+6, propagation: {{model: okumura-hata}}}}"
    run = start_run(scenario=STILL.replace("radio: moon2020", f"radio: {hata}"), duration_s=5.0)
    assert run.finish() != 0
    said = run.output.decode()
    assert "height of the base = " in said
    assert ": allowed is 30 to 200, the validity range of okumura-hata" in said
    assert "Traceback" not in said


LAW = """\
from itertools import count

from channel.propagation.path_loss import FreeSpace

calls = count()


class Broken(FreeSpace):
    def path_loss_db(self, path):
        if next(calls) > 60:
            raise AttributeError("no such quantity: distance_km")
        return super().path_loss_db(path)
"""


@pytest.mark.parametrize("processes", ["one", pytest.param("many", marks=pytest.mark.slow)])
def test_a_law_of_ones_own_that_fails_ends_the_run_with_what_it_raised(
    start_run: StartRun, tmp_path: Path, processes: str
) -> None:
    """Packets of that tick have no fate: the books cannot be closed, which is not what is told."""
    (tmp_path / "mine.py").write_text(LAW)
    own = f"{{{{preset: corrected, propagation: {{{{class: {tmp_path}/mine.py:Broken}}}}}}}}"
    run = start_run(
        scenario=STILL.replace("radio: moon2020", f"radio: {own}"), duration_s=5.0, processes=processes
    )
    assert run.finish() == 1
    assert "no such quantity: distance_km" in run.summary["error"]
    assert "LedgerError" not in run.summary["error"]


ANTENNA = """\
from channel.antenna import Isotropic


class Whip(Isotropic):
    gain_db: float = 1.25
"""
HEADING = "tx_north_m,tx_east_m,tx_height_m,rx_north_m,rx_east_m,rx_height_m,gain_db"


@pytest.mark.slow
def test_a_gain_map_and_an_own_antenna_are_in_the_record(start_run: StartRun, tmp_path: Path) -> None:
    """The map falls by 0.05 dB per metre to the north: 60 + 20.5 dB at 410 m."""
    (tmp_path / "mine.py").write_text(ANTENNA)
    grid = [
        f"0,0,0,{n},{e},{h},{-60.0 - 0.05 * n}" for n in (0, 300, 600) for e in (-100, 100) for h in (-5, 5)
    ]
    (tmp_path / "map.csv").write_text("\n".join([HEADING, *grid]))
    radio = (
        "{{preset: corrected, shadowing: {{model: none}}, antenna: {{class: 'mine.py:Whip'}}, "
        "propagation: {{model: gain-map, file: map.csv}}}}"
    )
    run = start_run(scenario=STILL.replace("radio: moon2020", f"radio: {radio}"), duration_s=3.0)
    assert run.finish() == 0, run.output.decode()
    rows = rows_of(run)
    assert rows
    for row in rows:
        assert row.received_power_dbm == pytest.approx(18.0 + 2 * 1.25 - 80.5, abs=0.05)
    assert {Path(path).name for path in read_provenance(run.directory).files} >= {"map.csv", "mine.py"}


@pytest.mark.slow
def test_terrain_from_a_file_lies_under_the_scenarios_origin(start_run: StartRun, tmp_path: Path) -> None:
    """A UA on the crest of the tile's ridge, 410 m north, and one in the plain: the same link by hand."""
    pytest.importorskip("rasterio", reason="needs rasterio: pip install 'lostlink[terrain]' (36 MB)")
    tile = Path(__file__).parents[3] / "data" / "ridge.tif"
    (tmp_path / "tile.tif").write_bytes(tile.read_bytes())
    law = "{{model: terrain, file: tile.tif, extent_m: 1000}}"
    radio = "{{preset: corrected, shadowing: {{model: none}}, "
    radio += f"noise: {{{{model: fixed, floor_dbm: -330}}}}, propagation: {law}}}}}"
    run = start_run(scenario=STILL.replace("radio: moon2020", f"radio: {radio}"), duration_s=3.0)
    assert run.finish() == 0, run.output.decode()
    place = {"origin_lat_deg": 40.1331, "origin_lon_deg": -105.2404, "origin_alt_amsl_m": 1690.0}
    terrain = {"model": "terrain", "file": str(tile), "extent_m": 1000.0} | place
    by_hand = Radio(
        radio_from_mapping({"preset": "corrected", "shadowing": {"model": "none"}, "propagation": terrain})
    )
    ends = {"position_tx_ned_m": (0.0, 0.0, 0.0), "position_rx_ned_m": (410.0, 0.0, 0.0)}
    expected = float(by_hand.link(**ends).received_power_dbm)
    free = {"preset": "corrected", "propagation": {"model": "free-space"}}
    in_the_open = float(Radio(radio_from_mapping(free)).link(410.0).received_power_dbm)
    assert expected < in_the_open - 5.0
    rows = rows_of(run)
    assert rows
    assert [row.received_power_dbm for row in rows] == pytest.approx([expected] * len(rows), abs=0.5)


SLOPE_M = [[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [50.0, 50.0], [50.0, 50.0]]
SLOPE = (
    f"{{{{model: terrain, origin_north_m: -200, origin_east_m: -100, spacing_m: 200, heights_m: {SLOPE_M}}}}}"
)


@pytest.mark.parametrize(
    ("north_m", "agent", "expected"),
    [
        (350, "{{type: still}}", ""),
        (
            620,
            "{{type: still}}",
            "below the terrain of the radio of network main: UA 1 by up to 5 m, first at 0 s: ",
        ),
        pytest.param(
            580,
            "{{type: out_and_back, altitude_m: 15, distance_m: 120, speed_mps: 12}}",
            "below the terrain of the radio of network main: UA 1 by up to 10 m, first at ",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_ua_below_the_terrain_is_told_of(
    start_run: StartRun, north_m: int, agent: str, expected: str
) -> None:
    """Ground that rises by 50 m from 600 to 800 m north."""
    scenario = STILL.replace("radio: moon2020", f"radio: {{{{preset: corrected, propagation: {SLOPE}}}}}")
    scenario = scenario.replace(
        "{{north_m: 410}}, agent: {{type: still}}", f"{{{{north_m: {north_m}}}}}, agent: {agent}"
    )
    run = start_run(scenario=scenario, duration_s=60.0 if "out" in agent else 0.5)
    assert run.finish() == 0, run.output.decode()
    told = [line for line in run.summary["warnings"] if "below the terrain" in line]
    assert told == [] if not expected else told[0].startswith(expected)


EDITED_BEFORE_IT_IS_LOADED = """
from pathlib import Path

from bridge.agents import Agent

Path(__file__).with_name("laws.py").write_text("GAIN = 3\\n", encoding="utf-8")
import laws


class Mine(Agent):
    async def fly(self):
        self.log("gain", laws.GAIN)
"""


@pytest.mark.parametrize("processes", ["one", pytest.param("many", marks=pytest.mark.slow)])
def test_code_that_is_edited_before_it_is_loaded_is_told(
    start_run: StartRun, tmp_path: Path, processes: str
) -> None:
    """Its digest is that of before: what is in the record did not fly."""
    laws = tmp_path / "laws.py"
    laws.write_text("GAIN = 2\n", encoding="utf-8")
    (tmp_path / "mine.py").write_text(EDITED_BEFORE_IT_IS_LOADED, encoding="utf-8")
    agent = f"{{{{type: own, class: '{tmp_path}/mine.py:Mine'}}}}"
    run = start_run(scenario=STILL.replace("{{type: still}}", agent, 1), duration_s=1.0, processes=processes)
    assert run.finish() == 0, run.output.decode()
    made = read_provenance(run.directory)
    assert made is not None
    assert made.files[str(laws)] == hashlib.sha256(b"GAIN = 2\n").hexdigest()
    told = f"{laws} was changed while the run flew: provenance.json has it as it was before"
    assert run.summary["may_not_repeat"] == [told]
    assert f"may not repeat: {told}" in run.output.decode()
