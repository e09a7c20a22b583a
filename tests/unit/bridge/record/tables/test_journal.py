"""The journal of a table: what was flushed can be read, whenever its writer was killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge.record.tables.deliveries import DELIVERIES, FATES, DeliveryWriter, Vocabulary
from bridge.record.tables.every import finish_tables
from bridge.record.tables.journal import BUFFER_ROWS, LABELS_MAX, TableWriter, names_path, read_rows
from bridge.record.tables.schema import TableError
from bridge.record.tables.truth import TRUTH
from tests.full_disk import no_file_beyond
from tests.unit.bridge.record.tables.rows import assert_same, fleet_columns, joined, read, write_deliveries

ROW: dict[str, Any] = {
    "sim_time_ns": 50_000_000,
    "tx": 0,
    "rx": 1,
    "seq": 7,
    "packets": 1,
    "length_bytes": 40,
    "distance_m": 123.456,
    "received_power_dbm": -330.25,
    "snr_db": 9.75,
    "per": 1.25e-5,
    "fate": 0,
    "radio": 0,
    "channel": 0,
    "encoding": 0,
    "received_ns": 100_000_000,
    "entered_ns": 60_000_000,
    "started_ns": 70_000_000,
    "ended_ns": 80_000_000,
    "arrived_ns": 80_000_001,
    "attempts": 2,
}
LAST_FATE = DELIVERIES.dtype.fields["fate"][1] + 1 - DELIVERIES.dtype.itemsize
"""Where the high byte of the last row's fate is, from the end."""


def test_what_was_flushed_is_there_while_the_writer_goes_on(tmp_path: Path) -> None:
    writer = DeliveryWriter(tmp_path, ("0", "gcs"))
    writer.append(1, **ROW)
    writer.append(2, **ROW | {"seq": np.array([8, 9]), "fate": np.array([1, FATES.index("transport")])})
    assert len(DELIVERIES.journal_path(tmp_path).read_bytes()) < 1000
    writer.flush()
    found = read(tmp_path)
    assert found["seq"].tolist() == [7, 8, 9]
    assert found["fate"].tolist() == ["delivered", "channel_erasure", "transport"]
    assert (found["tx"][0], found["rx"][0], found["per"][0]) == ("0", "gcs", 1.25e-5)
    writer.append(1, **ROW | dict.fromkeys(("distance_m", "received_power_dbm", "snr_db", "per"), np.nan))
    writer.close()
    writer.close()
    assert np.isnan(read(tmp_path)["snr_db"][3])


def test_a_disk_that_is_full_for_a_while_leaves_no_half_row_and_no_half_name(tmp_path: Path) -> None:
    words = Vocabulary()
    writer = DeliveryWriter(tmp_path, ("0", "gcs"), words)
    writer.append(1, **ROW)
    writer.flush()
    file = DELIVERIES.journal_path(tmp_path)
    writer.append(3, **ROW | {"seq": np.array([8, 9, 10]), "channel": words.places("channel", ["team"])[0]})
    for length_bytes, seqs in (5, [7]), (file.stat().st_size + DELIVERIES.dtype.itemsize * 3 // 2, [7, 8]):
        with no_file_beyond(length_bytes), pytest.raises(OSError, match="too large"):
            writer.flush()
        assert read(tmp_path)["seq"].tolist() == seqs
    writer.append(1, **ROW | {"seq": 11})
    writer.close()
    found = read(tmp_path)
    assert found["seq"].tolist() == [7, 8, 9, 10, 11]
    assert found["channel"].tolist() == ["", "team", "team", "team", ""]
    assert set(found["distance_m"].tolist()) == {123.456}


def test_names_may_come_as_rows_do(tmp_path: Path) -> None:
    """Whoever reads meanwhile has the names of all rows that are whole; a name that was cut off has no rows."""
    words = Vocabulary()
    writer = DeliveryWriter(tmp_path, ("0", "1"), words)
    for channel in ("team", "sensor", "team"):
        writer.append(1, **ROW | {"channel": words.places("channel", [channel])})
        writer.flush()
    writer.append(1, **ROW)
    writer.close()
    names = names_path(DELIVERIES.journal_path(tmp_path))
    assert names.read_text() == '["channel", "team"]\n["channel", "sensor"]\n'
    names.write_text(names.read_text() + '["channel", "ha')
    assert read(tmp_path)["channel"].tolist() == ["team", "sensor", "team", ""]
    finish_tables(tmp_path)
    assert read(tmp_path)["channel"].tolist() == ["team", "sensor", "team", ""]
    assert [path.name for path in tmp_path.iterdir()] == ["deliveries.parquet"]


def test_of_more_names_than_there_is_room_for_the_last_are_empty() -> None:
    words = Vocabulary()
    places = words.places("channel", [f"c{number}" for number in range(LABELS_MAX + 5)])
    assert (places[0], places[LABELS_MAX - 2], places[LABELS_MAX - 1]) == (1, LABELS_MAX - 1, 0)


def test_a_reader_between_two_halves_of_a_row_takes_whole_rows_only(tmp_path: Path) -> None:
    writer = DeliveryWriter(tmp_path, ("0", "1"))
    writer.append(4, **ROW | {"seq": np.arange(4)})
    writer.close()
    path = DELIVERIES.journal_path(tmp_path)
    whole = path.read_bytes()
    path.write_bytes(whole[: -DELIVERIES.dtype.itemsize - 5])
    rows = read_rows(path, DELIVERIES, 3)[1]
    assert next(rows)["seq"].tolist() == [0, 1]
    path.write_bytes(whole)
    assert list(rows) == []


@pytest.mark.parametrize("rows", [0, 1, BUFFER_ROWS - 1, BUFFER_ROWS, BUFFER_ROWS + 1, 3 * BUFFER_ROWS + 5])
def test_any_number_of_rows_at_once(tmp_path: Path, rows: int) -> None:
    writer = DeliveryWriter(tmp_path, ("0", "1"))
    for begin in (0, rows):
        writer.append(rows, **ROW | {"seq": np.arange(begin, begin + rows)})
    writer.close()
    assert [len(part) for part in read_rows(DELIVERIES.journal_path(tmp_path), DELIVERIES, 10**6)[1]] == (
        [2 * rows] if rows else []
    )
    if rows:
        assert (read(tmp_path)["seq"] == np.arange(2 * rows)).all()


def test_numbers_are_rounded_to_whole_steps_and_zero_has_no_sign(tmp_path: Path) -> None:
    writer = DeliveryWriter(tmp_path, ("0", "1"))
    given = {"distance_m": 1234.5674999, "received_power_dbm": -1e-9, "snr_db": -99.00051, "per": 0.12345678}
    writer.append(1, **ROW | given)
    writer.close()
    found = read(tmp_path)
    assert [float(found[name][0]) for name in given] == [1234.567, 0.0, -99.001, 0.1234568]
    assert not np.signbit(found["received_power_dbm"][0])


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"per": None}, ValueError, r"columns \['per'\] are missing or unknown"),
        ({"power": 1.0}, ValueError, "'power'"),
        ({"seq": np.arange(3)}, ValueError, r"seq has the shape \(3,\), not \(2,\)"),
        ({"seq": 1.5}, TypeError, "Cannot cast"),
        ({"tx": np.array([0.0, 1.0])}, TypeError, "Cannot cast"),
    ],
)
def test_a_callers_mistake_is_raised(
    tmp_path: Path, change: dict[str, Any], error: type[Exception], words: str
) -> None:
    labels = {"tx": "01", "rx": "01", "fate": FATES, **Vocabulary().names}
    writer = TableWriter(tmp_path, DELIVERIES, labels)
    row = {name: value for name, value in (ROW | change).items() if value is not None}
    with pytest.raises(error, match=words):
        writer.append(2, **row)
    with pytest.raises(ValueError, match=r"labels for \['tx'\]"):
        TableWriter(tmp_path, DELIVERIES, {"tx": "01"})
    with pytest.raises(ValueError, match="32769 names for a column; up to 32768 are allowed"):
        TableWriter(tmp_path, DELIVERIES, labels | {"rx": [str(node) for node in range(32769)]})
    writer.close()


@pytest.mark.slow
def test_every_beginning_of_a_journal_is_read(tmp_path: Path) -> None:
    ticks = list(fleet_columns(3, 4))
    write_deliveries(tmp_path / "whole", ticks, 3)
    raw, row_bytes = DELIVERIES.journal_path(tmp_path / "whole").read_bytes(), DELIVERIES.dtype.itemsize
    begin, whole = len(raw) - 24 * row_bytes, joined(ticks)
    run = tmp_path / "cut"
    run.mkdir()
    for length in range(len(raw) + 1):
        DELIVERIES.journal_path(run).write_bytes(raw[:length])
        labels, parts = read_rows(DELIVERIES.journal_path(run), DELIVERIES)
        rows = sum(len(part) for part in parts)
        assert rows == max(0, (length - begin) // row_bytes)
        assert labels["tx"] == (("0", "1", "2") if length >= begin else ())
        if rows and length % 97 == 0:
            assert_same(read(run), {name: values[:rows] for name, values in whole.items()})
    DELIVERIES.journal_path(run).write_bytes(raw[: begin + row_bytes + 5])
    finish_tables(run)
    assert not DELIVERIES.journal_path(run).exists()
    assert read(run)["tx"].tolist() == [whole["tx"][0]]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda raw: b"sim_time_ns,tx,rx\n" * 9, "not the journal of a table"),
        (
            lambda raw: raw.replace(b'"seq"', b'"sed"'),
            "not the columns of deliveries as this lostlink has them",
        ),
        (lambda raw: raw.replace(b'"labels"', b'"lables"'), "its header cannot be read"),
        (lambda raw: raw.replace(b'{"table"', b'["table"'), "its header cannot be read"),
        (lambda raw: raw[:8] + b"\xff\xff\xff\x7f" + raw[12:], "a header of 2147483647 bytes"),
        (
            lambda raw: raw[:LAST_FATE] + b"\x7f" + raw[LAST_FATE + 1 :],
            "a name that the file has not|out of bounds",
        ),
    ],
)
def test_a_foreign_or_damaged_journal_is_told(tmp_path: Path, change: Any, words: str) -> None:
    write_deliveries(tmp_path, list(fleet_columns(2, 2)), 2)
    path = DELIVERIES.journal_path(tmp_path)
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(TableError, match=words):
        read(tmp_path)
    with pytest.raises(TableError, match=words):
        finish_tables(tmp_path)
    assert path.exists()
    assert not DELIVERIES.parquet_path(tmp_path).exists()


def test_a_journal_of_another_table_is_told(tmp_path: Path) -> None:
    write_deliveries(tmp_path, list(fleet_columns(2, 2)), 2)
    DELIVERIES.journal_path(tmp_path).rename(TRUTH.journal_path(tmp_path))
    with pytest.raises(TableError, match="not the columns of truth"):
        read(tmp_path, TRUTH)


WRITER = """\
import sys, time
from pathlib import Path
import numpy as np
from bridge.record.tables.deliveries import DeliveryWriter
from bridge.run.every import Every
from bridge.timeouts import FLUSH_PERIOD_S

writer, flush, begin = DeliveryWriter(Path(sys.argv[1]), ("0", "1")), Every(FLUSH_PERIOD_S), 0
print("begins", flush=True)
while True:
    rows = 1 + begin % 57
    seq = np.arange(begin, begin + rows)
    writer.append(rows, sim_time_ns=time.monotonic_ns(), tx=seq % 2, rx=1 - seq % 2, seq=seq, length_bytes=40,
                  distance_m=seq / 1e3, received_power_dbm=-seq / 1e3, snr_db=seq / 1e3, per=np.nan, fate=0,
                  received_ns=0)
    begin += rows
    if flush.is_due():
        writer.flush()
        print(begin, flush=True)
    time.sleep(0.0005)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "number", [*range(8), *(pytest.param(number, marks=pytest.mark.long) for number in range(8, 30))]
)
def test_a_writer_killed_at_any_moment_leaves_what_it_has_flushed(tmp_path: Path, number: int) -> None:
    after_s = np.random.Generator(np.random.PCG64(number)).uniform(0.0, 2.5)
    command = [sys.executable, "-c", WRITER, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=Path.cwd()) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"begins\n"
        time.sleep(after_s)
        os.kill(process.pid, signal.SIGKILL)
        flushed = [0, *map(int, process.stdout)][-1]
    found = read(tmp_path) if DELIVERIES.journal_path(tmp_path).stat().st_size > 1000 else None
    assert (0 if found is None else len(found["seq"])) >= flushed
    if found is not None:
        seq = np.arange(len(found["seq"]))
        assert (found["seq"] == seq).all()
        assert (found["snr_db"] == seq / 1e3).all()
        assert (found["rx"] == np.where(seq % 2, "0", "1")).all()
        finish_tables(tmp_path)
        assert_same(read(tmp_path), found)


@pytest.mark.parametrize(
    "line", [b"5", b"[1, 2, 3]", b'["mood", "good"]', b"[" * 100_000, b"nan", b"\xf5", b'["channel", "\xe4"]']
)
def test_names_that_are_none_are_told_with_their_file(tmp_path: Path, line: bytes) -> None:
    DeliveryWriter(tmp_path, ("0", "1"), Vocabulary()).close()
    names = names_path(DELIVERIES.journal_path(tmp_path))
    names.write_bytes(line + b"\n")
    with pytest.raises(TableError, match=names.name):
        read(tmp_path)
