"""Parquet of a run: exactly what was written, the same bytes for the same rows, and small."""

from __future__ import annotations

import math
import multiprocessing
import time
import tracemalloc
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.bus.messages import Header, Quaternion, Truth, Vector3
from bridge.record.tables import reader
from bridge.record.tables.deliveries import (
    DELIVERIES,
    FATES,
    WORDS,
    DeliveryWriter,
    Vocabulary,
    read_deliveries,
)
from bridge.record.tables.every import finish_tables
from bridge.record.tables.parquet import GROUP_ROWS
from bridge.record.tables.reader import read_arrow, read_columns
from bridge.record.tables.schema import TableError
from bridge.record.tables.truth import TRUTH, TruthWriter
from tests.full_disk import no_file_beyond
from tests.unit.bridge.record.tables.rows import assert_same, fleet_columns, joined, read, write_deliveries

NODES = ("0", "1", "gcs-1")
NAMES = pa.dictionary(pa.int16(), pa.string())


def decimals(low: int, high: int, digits: int) -> st.SearchStrategy[float]:
    """Numbers with so many decimals, or nan: the oracle is the decimal text."""
    numbers = st.integers(low, high).map(lambda n: float(f"{n}e-{digits}"))
    return st.one_of(numbers, st.just(math.nan))


ROWS = st.lists(
    st.tuples(
        st.integers(0, 2**62),
        st.integers(0, 2),
        st.integers(0, 2),
        st.integers(0, 2**62),
        st.integers(1, 2**17),
        st.integers(0, 2**24),
        decimals(0, 10**10, 3),
        decimals(-(10**6), 10**6, 3),
        decimals(-(10**6), 10**6, 3),
        decimals(0, 10**7, 7),
        st.integers(0, len(FATES) - 1),
        *[st.text(st.characters(codec="utf-8"), max_size=3)] * 2,
        st.text(st.characters(codec="utf-8"), max_size=3),
        st.integers(0, 2**62),
        *[st.integers(-1, 2**62)] * 4,
        st.integers(0, 2**17),
    ),
    max_size=30,
)


def test_a_table_is_read_whole_in_little_more_memory_than_it_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_deliveries(tmp_path, list(fleet_columns(20, 200)), 20)
    finish_tables(tmp_path)
    monkeypatch.setattr(reader, "READ_ROWS", 2000)
    nodes, names = [str(node) for node in range(20)], ("tx", "rx", "fate")
    read_deliveries(tmp_path, nodes, names)
    tracemalloc.start()
    try:
        found = read_deliveries(tmp_path, nodes, names)
        peak_bytes = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    whole_bytes = sum(values.nbytes for values in found.values())
    assert whole_bytes > 1_000_000
    assert peak_bytes < 1.3 * whole_bytes


@settings(deadline=None, max_examples=60)
@given(ROWS, st.lists(st.integers(1, 7), min_size=1))
def test_written_decimals_come_back_exactly(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[Any, ...]], parts: list[int]
) -> None:
    run = tmp_path_factory.mktemp("run")
    words = Vocabulary()
    writer, begin = DeliveryWriter(run, NODES, words, routed=True, parted=True), 0  # which has all fates
    names = [column.name for column in DELIVERIES.columns]
    while begin < len(rows):
        part = rows[begin : begin + parts[begin % len(parts)]]
        columns = dict(zip(names, zip(*part, strict=True), strict=True))
        columns |= {name: words.places(name, columns[name]) for name in WORDS}
        writer.append(len(part), **{name: np.array(values) for name, values in columns.items()})
        writer.flush()
        begin += len(part)
    writer.close()
    finish_tables(run)
    found = pq.read_table(DELIVERIES.parquet_path(run)).to_pylist()
    expected = [(r[0], NODES[r[1]], NODES[r[2]], *r[3:10], FATES[r[10]], *r[11:]) for r in rows]
    assert [tuple(map(repr, row.values())) for row in found] == [tuple(map(repr, row)) for row in expected]


def test_bytes_follow_from_the_rows_alone(tmp_path: Path) -> None:
    ticks = list(fleet_columns(4, 30))
    whole = {name: np.concatenate([tick[name] for tick in ticks]) for name in ticks[0]}
    write_deliveries(tmp_path / "a", ticks, 4)
    write_deliveries(tmp_path / "b", [whole], 4)
    writer = DeliveryWriter(tmp_path / "b", list("0123"))
    for tick in ticks:
        writer.append(len(tick["tx"]), **tick)
        writer.flush()
    writer.close()
    for run in ("a", "b"):
        finish_tables(tmp_path / run)
        assert [path.name for path in (tmp_path / run).iterdir()] == ["deliveries.parquet"]
    a, b = (DELIVERIES.parquet_path(tmp_path / run).read_bytes() for run in "ab")
    assert a == b
    assert_same(read(tmp_path / "a"), joined(ticks))


def test_bytes_do_not_tell_who_met_a_word_first(tmp_path: Path) -> None:
    """A run meets channels in the order in which packets are decided, a redecision in that of the table's rows."""
    (tick,) = fleet_columns(3, 1)
    rows = len(tick["tx"])
    said = [("", "a", "b")[number % 3] for number in range(rows)]
    for run, met in (("a", ["b", "nobody's", "a"]), ("b", [])):
        words = Vocabulary()
        words.places("channel", met)
        writer = DeliveryWriter(tmp_path / run, list("012"), words)
        writer.append(rows, **tick | {"channel": words.places("channel", said)})
        writer.close()
        finish_tables(tmp_path / run)
    a, b = (DELIVERIES.parquet_path(tmp_path / run).read_bytes() for run in "ab")
    assert a == b
    assert pq.read_table(DELIVERIES.parquet_path(tmp_path / "a"))["channel"].to_pylist() == said


def test_truth_has_all_of_its_message_to_the_last_bit(tmp_path: Path) -> None:
    writer = TruthWriter(tmp_path, NODES)
    rng = np.random.Generator(np.random.PCG64(1))

    def vector() -> Vector3:
        return Vector3(*rng.normal(size=3).tolist())

    states = [
        Truth(
            Header.at(7 + number, node),
            *rng.normal(size=3).tolist(),
            vector(),
            vector(),
            Quaternion(*rng.normal(size=4).tolist()),
            vector(),
            vector(),
            -0.0 if number else math.nan,
            vector(),
        )
        for number, node in enumerate(NODES)
    ]
    writer.append(5, states)
    writer.append(6, [])
    writer.append(6, states[1:])
    writer.close()
    finish_tables(tmp_path)
    rows = pq.read_table(TRUTH.parquet_path(tmp_path)).to_pylist()
    assert [(row["tick_ns"], row["node"], row["sim_time_ns"]) for row in rows] == [
        *((5, node, 7 + number) for number, node in enumerate(NODES)),
        *((6, node, 8 + number) for number, node in enumerate(NODES[1:])),
    ]
    for row, state in zip(rows, states + states[1:], strict=True):
        q = state.attitude
        expected = {
            "longitude_deg": state.longitude_deg,
            "latitude_deg": state.latitude_deg,
            "altitude_amsl_m": state.altitude_amsl_m,
            "attitude_w": q.w,
            "attitude_x": q.x,
            "attitude_y": q.y,
            "attitude_z": q.z,
            "airspeed_mps": state.airspeed_mps,
        }
        for name, vector3, axes, unit in (
            ("position", state.position_ned_m, ("north", "east", "down"), "_m"),
            ("velocity", state.velocity_ned_mps, ("north", "east", "down"), "_mps"),
            ("body_rate", state.body_rates_frd_radps, ("forward", "right", "down"), "_radps"),
            ("specific_force", state.specific_force_frd_mps2, ("forward", "right", "down"), "_mps2"),
            ("wind", state.wind_ned_mps, ("north", "east", "down"), "_mps"),
        ):
            expected |= {f"{name}_{axis}{unit}": value for axis, value in zip(axes, vector3.xyz, strict=True)}
        assert {name: repr(row[name]) for name in expected} == {n: repr(v) for n, v in expected.items()}
        assert len(row) == 3 + len(expected)


def test_a_table_is_read_from_parquet_as_from_its_journal(tmp_path: Path) -> None:
    ticks = list(fleet_columns(3, 5))
    write_deliveries(tmp_path, ticks, 3)
    before = read(tmp_path)
    finish_tables(tmp_path)
    assert_same(before, joined(ticks))
    assert_same(read(tmp_path), before)


def test_an_end_that_was_killed_itself_is_made_up_for(tmp_path: Path) -> None:
    ticks = list(fleet_columns(3, 5))
    write_deliveries(tmp_path, ticks, 3)
    journal = DELIVERIES.journal_path(tmp_path).read_bytes()
    path = DELIVERIES.parquet_path(tmp_path)
    path.with_name(path.name + ".1.partial").write_bytes(b"PAR1 half of it")
    finish_tables(tmp_path)
    assert list(tmp_path.iterdir()) == [path]
    DELIVERIES.journal_path(tmp_path).write_bytes(journal)  # killed before it was removed
    assert_same(read(tmp_path), joined(ticks))
    finish_tables(tmp_path)
    assert not DELIVERIES.journal_path(tmp_path).exists()
    assert_same(read(tmp_path), joined(ticks))


def test_two_processes_may_finish_one_run(tmp_path: Path) -> None:
    fork = multiprocessing.get_context("fork")
    ticks = list(fleet_columns(3, 500))
    write_deliveries(tmp_path, ticks, 3)
    ready = fork.Barrier(2)

    def finish() -> None:
        ready.wait(10.0)
        finish_tables(tmp_path)

    others = [fork.Process(target=finish) for _ in range(2)]
    for each in others:
        each.start()
    for each in others:
        each.join()
    assert [each.exitcode for each in others] == [0, 0]
    assert_same(read(tmp_path), joined(ticks))
    assert list(tmp_path.iterdir()) == [DELIVERIES.parquet_path(tmp_path)]


def test_an_end_that_finds_no_room_on_the_disk_leaves_what_was_there(tmp_path: Path) -> None:
    ticks = list(fleet_columns(3, 5))
    write_deliveries(tmp_path, ticks, 3)
    with no_file_beyond(100), pytest.raises(OSError, match="too large"):
        finish_tables(tmp_path)
    assert list(tmp_path.iterdir()) == [DELIVERIES.journal_path(tmp_path)]
    assert_same(read(tmp_path), joined(ticks))


def test_row_groups_have_a_fixed_number_of_rows(tmp_path: Path) -> None:
    rows = GROUP_ROWS + 1000
    writer = DeliveryWriter(tmp_path, NODES)
    writer.append(
        rows,
        **dict.fromkeys(("sim_time_ns", "tx", "rx", "length_bytes", "fate", "received_ns"), 0),
        **dict.fromkeys(("distance_m", "received_power_dbm", "snr_db", "per"), 0.5),
        seq=np.arange(rows),
    )
    writer.close()
    told: list[tuple[str, int]] = []
    finish_tables(tmp_path, lambda name, done: told.append((name, done)))
    metadata = pq.ParquetFile(DELIVERIES.parquet_path(tmp_path)).metadata
    assert [metadata.row_group(i).num_rows for i in range(metadata.num_row_groups)] == [GROUP_ROWS, 1000]
    assert told == [("deliveries", GROUP_ROWS), ("deliveries", rows)]
    assert (read(tmp_path)["seq"] == np.arange(rows)).all()


def spoil_column(path: Path) -> None:
    table = pq.read_table(path)
    pq.write_table(table.set_column(3, "seq", table.column("seq").cast(pa.float64())), path)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda path: path.write_bytes(b""), "damaged"),
        (lambda path: path.write_bytes(path.read_bytes()[:-20]), "damaged"),
        (
            lambda path: path.write_bytes(path.read_bytes()[:40] + bytes(200) + path.read_bytes()[240:]),
            "damaged",
        ),
        (
            lambda path: pq.write_table(pq.read_table(path).drop_columns(["per"]), path),
            "no such column.*: per",
        ),
        (spoil_column, "no such column.*: seq"),
        (lambda path: path.unlink(), r"has no deliveries\.parquet, nor a journal"),
    ],
)
def test_what_is_damaged_or_not_there_is_told(tmp_path: Path, spoil: Any, words: str) -> None:
    write_deliveries(tmp_path, list(fleet_columns(3, 40)), 3)
    finish_tables(tmp_path)
    spoil(DELIVERIES.parquet_path(tmp_path))
    with pytest.raises(TableError, match=words):
        read(tmp_path)


def taken_s(what: Callable[[], object]) -> float:
    """Of CPU time."""
    began_s = time.process_time()
    what()
    return time.process_time() - began_s


def write_plainly(path: Path, ticks: list[dict[str, Any]]) -> None:
    """The same columns, by Arrow as they are."""
    batches = [pa.RecordBatch.from_pydict(tick) for tick in ticks]
    with pa.OSFile(str(path), "wb") as sink, pa.ipc.new_stream(sink, batches[0].schema) as writer:
        for batch in batches:
            writer.write_batch(batch)


@pytest.mark.slow
def test_a_million_receptions_are_small_and_quickly_written(tmp_path: Path) -> None:
    ticks = list(fleet_columns(50, 409))
    rows = sum(len(tick["tx"]) for tick in ticks)
    assert rows > 1_000_000
    plain_s = min(taken_s(lambda: write_plainly(tmp_path / "plain", ticks)) for _ in range(3))
    runs = [tmp_path / str(number) for number in range(3)]
    for run in runs:
        run.mkdir()
    own_s = min(taken_s(partial(write_deliveries, run, ticks, 50)) for run in runs)
    write_deliveries(tmp_path, ticks, 50)
    finish_tables(tmp_path)
    assert DELIVERIES.parquet_path(tmp_path).stat().st_size < 20e6
    assert own_s < 2.0 * plain_s
    assert_same(read(tmp_path), joined(ticks))


@pytest.mark.parametrize(
    ("column", "made"),
    [
        ("tx", lambda values: pa.array([None, *values[1:]]).dictionary_encode().cast(NAMES)),
        ("tx", pa.array),
        ("seq", lambda values: pa.array([None, *values[1:]], pa.int64())),
        ("snr_db", lambda values: pa.array([None, *values[1:]])),
    ],
    ids=["no name", "plain names", "no whole number", "no number"],
)
def test_a_column_of_foreign_make_is_told(tmp_path: Path, column: str, made: Callable[[Any], Any]) -> None:
    write_deliveries(tmp_path, list(fleet_columns(3, 2)), 3)
    finish_tables(tmp_path)
    path = DELIVERIES.parquet_path(tmp_path)
    content = pq.read_table(path)
    values = content.column(column).to_pylist()
    pq.write_table(content.set_column(content.column_names.index(column), column, made(values)), path)
    why = f"{path}: (a row has no value in|no such column as in deliveries:) {column}"
    with pytest.raises(TableError, match=why):
        read(tmp_path)
    with pytest.raises(TableError, match=why):
        read_columns(tmp_path, DELIVERIES, None, {"tx": NODES, "rx": NODES, "fate": FATES})
    with pytest.raises(TableError, match=why):
        read_arrow(tmp_path, DELIVERIES)


@pytest.mark.parametrize("finish", [finish_tables, lambda _: None], ids=["Parquet", "journal"])
def test_names_as_places_in_a_list_that_has_them_all(tmp_path: Path, finish: Any) -> None:
    ticks = list(fleet_columns(3, 5))
    write_deliveries(tmp_path, ticks, 3)
    finish(tmp_path)
    found = read_deliveries(tmp_path, ("x", "2", "1", "0"), ("tx", "rx", "seq"))
    whole = joined(ticks)
    assert [list(found), set(found["tx"].tolist())] == [["tx", "rx", "seq"], {1, 2, 3}]
    for end in ("tx", "rx"):
        assert found[end].tolist() == [3 - int(node) for node in whole[end]]
    assert found["seq"].tolist() == whole["seq"].tolist()
    with pytest.raises(
        TableError, match=r"/deliveries\..*: a row has a name that is none of this run's: '2'"
    ):
        read_deliveries(tmp_path, ("0", "1"))
    with pytest.raises(TableError, match="deliveries has no column snr; there are sim_time_ns, tx"):
        read_deliveries(tmp_path, ("0", "1", "2"), ("snr",))


def test_what_was_read_of_a_file_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bridge.record.tables.parquet.GROUP_ROWS", 1 << 12)
    write_deliveries(tmp_path, list(fleet_columns(20, 300)), 20)
    finish_tables(tmp_path)
    for _ in reader.read_batches(tmp_path, DELIVERIES):
        break  # imports
    tracemalloc.start()
    rows = sum(len(batch["tx"]) for batch in reader.read_batches(tmp_path, DELIVERIES))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert rows == 20 * 19 * 300
    assert peak < 0.6 * DELIVERIES.parquet_path(tmp_path).stat().st_size
