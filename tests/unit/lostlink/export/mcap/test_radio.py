"""What a file says of links is what the run published, tick by tick, also where the host lost packets."""

from __future__ import annotations

from pathlib import Path
from resource import RLIMIT_NOFILE, getrlimit, setrlimit
from socket import socket

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.reader import read_columns
from bridge.record.tables.schema import TIME_MAX_NS
from bridge.record.tables.truth import TRUTH
from bridge.scenario.mcap import McapSettings
from lostlink.export.mcap.export import WINDOWS_MAX, write_mcap
from lostlink.reading.run import load_run
from lostlink.replay.player import Player
from tests.unit.lostlink.export.mcap.files import read_mcap
from tests.unit.lostlink.replay.flown import TICK_NS, Sent, flown, scenario_of

NODES = ("0", "1", "gcs")


def some(tick: int) -> list[Sent]:
    """UA 0 loses two packets on its way to the radio now and then; gcs speaks to one node."""
    return [Sent("0", lost=2 * (tick % 5 == 3)), Sent("1"), Sent("gcs", to="1")]


@pytest.mark.parametrize("killed", [False, True])
def test_links_and_who_was_heard_are_those_of_the_run(tmp_path: Path, killed: bool) -> None:
    run = flown(tmp_path / "run", scenario_of("perfect", NODES), 40, some, killed=killed)
    write_mcap(run, tmp_path / "run.mcap", McapSettings(rates_hz={"links": 1000.0}))
    read = read_mcap(tmp_path / "run.mcap")
    moments = 0
    for moment, links, matrix in zip(
        Player.open(run).moments(), read.messages["/links"], read.messages["/communication"], strict=True
    ):
        expected = moment.links()
        for name in ("tx", "rx", "sent", "delivered"):
            assert list(getattr(links, name)) == list(getattr(expected, name)), (moment.sim_time_ns, name)
        assert links.snr_db == pytest.approx(list(expected.snr_db), abs=0.01, nan_ok=True)
        assert list(matrix.delivered) == list(moment.communication().delivered)
        moments += 1
    assert moments == 40
    assert sum(len(fates.seq) for fates in read.messages["/fates"]) == 40 * 5 + 8 * 2


@pytest.mark.slow
def test_on_a_medium_that_takes_time_links_are_those_of_the_run_in_every_window(tmp_path: Path) -> None:
    """Slots of half a second: packets that wait for one arrive behind others stamped later, also across 5 s windows."""
    radio = "{preset: perfect, bit_rate_bps: 1000000, medium: {model: tdma, slot_s: 0.5, guard_s: 0.01}}"
    run = flown(tmp_path / "run", scenario_of(radio, NODES), 250)
    write_mcap(run, tmp_path / "run.mcap", McapSettings(rates_hz={"links": 1000.0}))
    read = read_mcap(tmp_path / "run.mcap")  # whose reader asserts that times rise
    assert read.times_ns["/links"] == sorted(set(read.times_ns["/links"]))
    rows = read_columns(run, DELIVERIES, ("sim_time_ns", "seq", "received_ns"))
    assert (np.diff(rows["sim_time_ns"]) < 0).any()
    assert len(rows["seq"]) == 250 * 3 * 2
    found = [
        (tick_ns + TICK_NS, seq)
        for tick_ns, fates in zip(read.times_ns["/fates"], read.messages["/fates"], strict=True)
        for seq in fates.seq
    ]
    assert sorted(found) == sorted(zip(rows["received_ns"].tolist(), rows["seq"].tolist(), strict=True))
    sent = [sum(links.sent) for links in read.messages["/links"]]
    assert sent == np.cumsum(np.unique(rows["received_ns"], return_counts=True)[1]).tolist()


@pytest.mark.slow
@pytest.mark.parametrize("ticks", [3, 41, 100, 108])
def test_the_last_links_have_the_counts_of_the_whole_run(tmp_path: Path, ticks: int) -> None:
    """At whatever rate, and whether a window of 5 s has just begun."""
    run = flown(tmp_path / "run", scenario_of("wifi-2.4", NODES), ticks)
    write_mcap(run, tmp_path / "run.mcap", McapSettings())
    read = read_mcap(tmp_path / "run.mcap")
    last, whole = read.messages["/links"][-1], load_run(run).links
    assert list(last.sent) == whole["sent"].tolist()
    assert list(last.delivered) == whole["delivered"].tolist()
    assert len(read.messages["/links"]) == -(-ticks // 10) + (ticks % 10 != 1)


def test_a_rate_that_is_next_to_none_leaves_the_first_message(tmp_path: Path) -> None:
    run = flown(tmp_path / "run", scenario_of("perfect", NODES), 30)
    counts = write_mcap(run, tmp_path / "run.mcap", McapSettings(rates_hz={"truth": 1e-12, "packets": 1e-12}))
    assert (counts["/ua_0/truth"], counts["/ua_0/packets"]) == (1, 1)


def test_what_was_under_way_when_a_run_ended_in_its_first_tick_is_there(tmp_path: Path) -> None:
    run = flown(tmp_path / "run", scenario_of("perfect", NODES), 1)
    path = run / "deliveries.parquet"
    rows = pq.read_table(path)
    place = rows.schema.get_field_index("received_ns")
    pq.write_table(rows.set_column(place, "received_ns", pa.array(np.zeros(len(rows), np.int64))), path)
    write_mcap(run, tmp_path / "run.mcap", McapSettings())
    read = read_mcap(tmp_path / "run.mcap")
    assert read.times_ns["/fates"] == read.times_ns["/links"] == [0]
    assert sum(read.messages["/links"][0].sent) == len(rows)


def with_tick(run: Path, row: int, tick_ns: int) -> None:
    """Write another tick into a row of the true states, as by hand."""
    path = TRUTH.parquet_path(run)
    table = pq.read_table(path)
    ticks_ns = table["tick_ns"].to_pylist()
    ticks_ns[row] = tick_ns
    column = table.schema.get_field_index("tick_ns")
    pq.write_table(table.set_column(column, "tick_ns", pa.array(ticks_ns)), path)


def test_a_record_that_says_it_is_weeks_long_is_written_all_the_same(tmp_path: Path) -> None:
    run = flown(tmp_path / "run", scenario_of("perfect", NODES), 5)
    with_tick(run, -1, TIME_MAX_NS)
    windows: list[float] = []
    write_mcap(run, tmp_path / "run.mcap", McapSettings(), windows.append)
    assert len(windows) <= WINDOWS_MAX + 2


@pytest.mark.parametrize("tick_ns", [-1, TIME_MAX_NS + 1])
def test_times_that_no_run_has_are_told(tmp_path: Path, tick_ns: int) -> None:
    run = flown(tmp_path / "run", scenario_of("perfect", NODES), 5)
    with_tick(run, 0, tick_ns)
    with pytest.raises(ValueError, match=f"truth.parquet: tick_ns {tick_ns}: has to be from 0"):
        write_mcap(run, tmp_path / "run.mcap", McapSettings())
    assert not (tmp_path / "run.mcap").exists()


def test_a_run_of_many_nodes_is_written_where_few_files_may_be_open(tmp_path: Path) -> None:
    nodes = [str(number) for number in range(40)]
    run = flown(tmp_path / "run", scenario_of("perfect", nodes), 2, scale=0.01)
    now, most = getrlimit(RLIMIT_NOFILE)
    with socket() as probe:
        setrlimit(RLIMIT_NOFILE, (probe.fileno() + 20, most))
    try:
        write_mcap(run, tmp_path / "run.mcap", McapSettings())
    finally:
        setrlimit(RLIMIT_NOFILE, (now, most))
    assert len(read_mcap(tmp_path / "run.mcap").messages) > len(nodes)
