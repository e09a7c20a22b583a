"""Tables for the rest of the world: CSV, and Parquet of a run that was killed before it had any."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.every import TABLES
from bridge.record.tables.logged import LoggedRow, logged_rows
from bridge.record.tables.reader import read_batches
from bridge.record.tables.schema import Column, Table, TableError
from bridge.run.whole_file import whole_file


def export_csv(run: Path, folder: Path) -> list[Path]:
    """Write a CSV of each table that the run has, and `logged.csv` if agents logged anything; returns the files.

    Raises:
        ValueError: it has no table, or one is damaged.
        OSError: a file cannot be read or written.
    """
    found = [table for table in TABLES if table.is_in(run)]
    if not found:
        raise TableError(f"{run}: it has neither {', nor '.join(table.name for table in TABLES)}")
    written = [
        _write(folder / f"{table.name}.csv", [column.name for column in table.columns], _rows(run, table))
        for table in found
    ]
    logged = logged_rows(run)
    first = next(logged, None)
    if first is not None:
        written.append(_write(folder / "logged.csv", LoggedRow._fields, chain([first], logged)))
    return written


def _write(path: Path, names: Sequence[str], rows: Iterable[Sequence[Any]]) -> Path:
    with whole_file(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(_Lines(file), lineterminator="\r\n")  # and so it quotes either of them in a text
        writer.writerow(names)
        writer.writerows(rows)
    return path


class _Lines:
    """Takes lines that end with CR LF, and writes them with LF."""

    def __init__(self, file: TextIO) -> None:
        self._file = file

    def write(self, line: str) -> None:
        self._file.write(line.removesuffix("\r\n") + "\n")


def _rows(run: Path, table: Table) -> Iterator[Sequence[Any]]:
    for batch in read_batches(run, table):
        yield from zip(*(_texts(column, batch[column.name]) for column in table.columns), strict=True)


def _texts(column: Column, values: NDArray[Any]) -> Iterator[Any]:
    """Numbers in steps with all decimals of a step, others with as many as distinguish them from their neighbours."""
    if not column.steps_per_unit:
        return iter(values.tolist())
    decimals = round(np.log10(column.steps_per_unit))
    return (f"{value:.{decimals}f}" for value in values.tolist())
