"""Tables that are read while their journals become Parquet: whichever instant that is, all rows are there."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bridge.record.tables.every import finish_tables
from bridge.record.tables.journal import names_path
from bridge.record.tables.parquet import write_parquet
from bridge.record.tables.reader import read_arrow, read_batches
from bridge.record.tables.schema import Table
from bridge.record.tables.states import STATES
from tests.unit.bridge.record.tables.test_journals import write
from tests.unit.bridge.record.tables.test_parquet import DELIVERIES, fleet_columns, write_deliveries

LOOKS_MAX = 60


def one_gone(run: Path) -> None:
    """As far as that there is Parquet, and the first journal has gone."""
    for table in (STATES, DELIVERIES):
        write_parquet(run, table, lambda _name, _rows: None)
        table.journals(run)[0].unlink()


def names_gone(run: Path) -> None:
    """As far as the names of the table of deliveries."""
    one_gone(run)
    names_path(DELIVERIES.journal_path(run)).unlink(missing_ok=True)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("recorded")
    write(run, ticks=300)
    write_deliveries(run, list(fleet_columns(3, 40)), 3)
    return run


def read_while(run: Path, table: Table, monkeypatch: pytest.MonkeyPatch, at: int, become: Any) -> list[Any]:
    """The rows, with ``become`` done just before the ``at``-th time that reading looks for a file."""
    looks = 0

    def watched(method: Callable[..., Any]) -> Callable[..., Any]:
        def look(path: Path, *arguments: Any, **named: Any) -> Any:
            nonlocal looks
            looks += 1
            if looks == at:
                become(run)
            return method(path, *arguments, **named)

        return look

    with monkeypatch.context() as patched:
        for name in ("open", "exists", "glob"):
            patched.setattr(Path, name, watched(getattr(Path, name)))
        return [
            tuple(row)
            for batch in read_batches(run, table)
            for row in zip(*(column.tolist() for column in batch.values()), strict=True)
        ]


@pytest.mark.parametrize("become", [finish_tables, one_gone, names_gone])
@pytest.mark.parametrize("table", [STATES, DELIVERIES], ids=lambda table: table.name)
def test_no_row_is_missing_whenever_it_becomes_parquet(
    recorded: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    table: Table,
    become: Callable[[Path], object],
) -> None:
    whole = read_arrow(recorded, table).num_rows
    assert whole > 100
    happened = 0
    for at in range(1, LOOKS_MAX):
        run = tmp_path / str(at)
        shutil.copytree(recorded, run)
        assert len(read_while(run, table, monkeypatch, at, become)) == whole, f"look {at}"
        if not table.parquet_path(run).exists():
            break  # reading looks less often than that
        happened += 1
    assert happened > 3
