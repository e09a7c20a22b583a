"""A table with a journal for each node becomes one: by tick, then by node."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from bridge.bus.messages import AircraftState, Header, Vector3
from bridge.record.tables import journals
from bridge.record.tables.every import finish_tables
from bridge.record.tables.reader import read_arrow, read_columns
from bridge.record.tables.schema import TableError
from bridge.record.tables.states import AGES, BUFFER_ROWS, STATES, StateWriter
from tests.full_disk import no_file_beyond

NODES = ("2", "10", "gcs")


def write(run: Path, nodes: tuple[str, ...] = NODES, ticks: int = 700) -> list[tuple[int, str, float, str]]:
    """Each node at a pace of its own; nodes are numbered before they are named, and 2 comes before 10."""
    expected = []
    for number, node in enumerate(nodes):
        rows = StateWriter(run, node)
        for i in range(ticks // (number + 1)):
            tick_ns = i * (number + 1) * 100
            state = AircraftState(
                Header.at(tick_ns, node),
                1,
                Vector3(0.1, 0.2, i),
                altitude_rel_m=i + 0.1,
                mode=f"MODE {i % 3}",
                base_mode="é" * 100,
                armed=bool(i % 2),
                age_s=[0.05 * place for place in range(len(AGES))],
            )
            rows.append(state)
            expected.append((tick_ns, number, node, i + 0.1, f"MODE {i % 3}", i % 2))
        rows.close()
    return [(t, node, *rest) for t, _, node, *rest in sorted(expected)]


def rows_in(run: Path) -> list[tuple[object, ...]]:
    names = ("tick_ns", "node", "altitude_rel_m", "mode", "armed")
    return list(zip(*read_columns(run, STATES, names).values(), strict=True))


@pytest.mark.parametrize("chunk", [7, 100, 1 << 16])
def test_rows_of_all_nodes_by_tick(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chunk: int) -> None:
    expected = write(tmp_path)
    assert len(expected) > 2 * BUFFER_ROWS
    labels, arrays = journals.rows_of(tmp_path, STATES, chunk)
    sizes = [len(rows) for rows in arrays]
    assert labels == {"node": NODES}
    assert set(sizes[:-1]) <= {chunk}
    assert sum(sizes) == len(expected)
    assert rows_in(tmp_path) == expected
    killed = read_arrow(tmp_path, STATES)
    finish_tables(tmp_path)
    assert rows_in(tmp_path) == expected
    assert read_arrow(tmp_path, STATES).to_pydict() == killed.to_pydict()
    assert [path.name for path in tmp_path.iterdir()] == ["states.parquet"]


def test_rows_wait_for_room_on_the_disk_and_one_that_finds_none_is_told_each_time(tmp_path: Path) -> None:
    rows = StateWriter(tmp_path, "0")
    with no_file_beyond(1):
        for tick_ns in range(BUFFER_ROWS - 1):
            rows.append(AircraftState(Header.at(tick_ns, "0")))
        for tick_ns in range(BUFFER_ROWS - 1, BUFFER_ROWS + 2):
            with pytest.raises(OSError, match="too large"):
                rows.append(AircraftState(Header.at(tick_ns, "0")))
    rows.append(AircraftState(Header.at(1000, "0")))
    rows.close()
    assert [row[0] for row in rows_in(tmp_path)] == [*range(BUFFER_ROWS), 1000]


def test_text_that_is_too_long_is_cut(tmp_path: Path) -> None:
    write(tmp_path, ("0",), 2)
    finish_tables(tmp_path)
    (text,) = set(pq.read_table(STATES.parquet_path(tmp_path))["base_mode"].to_pylist())
    assert text == "é" * 96


def test_a_journal_that_was_cut_off_has_its_beginning(tmp_path: Path) -> None:
    expected = write(tmp_path)
    path = STATES.journal_path(tmp_path, "10")
    path.write_bytes(path.read_bytes()[: -STATES.dtype.itemsize - 1])
    kept = [row for row in expected if row[1] == "10"][:-2]
    assert rows_in(tmp_path) == sorted(
        (row for row in expected if row[1] != "10" or row in kept), key=lambda row: row[0]
    )
    path.write_bytes(b"")
    assert rows_in(tmp_path) == [row for row in expected if row[1] != "10"]


def test_a_place_without_a_name_is_told(tmp_path: Path) -> None:
    write(tmp_path, ("0",), 3)
    path = STATES.journal_path(tmp_path, "0")
    rows = np.frombuffer(path.read_bytes()[-STATES.dtype.itemsize :], STATES.dtype).copy()
    rows["node"] = 1
    path.write_bytes(path.read_bytes() + rows.tobytes())
    with pytest.raises(TableError, match=r"0\.journal: a row has a name that the file has not"):
        rows_in(tmp_path)
