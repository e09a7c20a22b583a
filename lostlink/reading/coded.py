"""Whole tables of a run as arrays, names as places in lists of ours: from Parquet, or a killed run's journals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.columns import values_of
from bridge.record.tables.journal import read_rows
from bridge.record.tables.parquet import read_batches
from bridge.record.tables.schema import LABEL, Column, Table, TableError

Columns = dict[str, NDArray[Any]]
BATCH_ROWS = 1 << 17


def coded_columns(
    run: Path, table: Table, labels: Mapping[str, Sequence[str]], names: Sequence[str] | None = None
) -> Columns:
    """The columns of a table of the run in ``run``, each as one array.

    Args:
        run: the run directory.
        table: which table.
        labels: for each column of names all that may be there; the array has places in it. A list takes up the names
            that it lacks, as they come.
        names: of the columns wanted; all of them unless given.

    Raises:
        TableError: there is no such table, it is damaged, or has a name that ``labels`` lacks.
        OSError: it cannot be read.
    """
    wanted = [column for column in table.columns if names is None or column.name in names]
    return joined(table, list(_batches(run, table, wanted, labels)), [column.name for column in wanted])


def joined(table: Table, parts: Sequence[Columns], names: Sequence[str] | None = None) -> Columns:
    """The rows of all parts, one part behind the other; of all columns unless ``names`` are given."""
    empty = no_rows(table)
    return {name: np.concatenate([empty[name], *(part[name] for part in parts)]) for name in names or empty}


def no_rows(table: Table) -> Columns:
    """The columns of a table that has no rows."""
    return {column.name: np.empty(0, _kind(column)) for column in table.columns}


def _kind(column: Column) -> np.dtype[Any]:
    return np.dtype(np.intp) if column.dtype == LABEL else np.dtype(column.dtype).newbyteorder("=")


def _batches(
    run: Path, table: Table, columns: Sequence[Column], labels: Mapping[str, Sequence[str]]
) -> Iterator[Columns]:
    if table.parquet_path(run).exists():
        return _parquet(table.parquet_path(run), table, columns, labels)
    if table.journal_path(run).exists():
        return _journal(table.journal_path(run), table, columns, labels)
    raise TableError(f"{run}: it has no {table.parquet_path(run).name}, nor a journal of it")


def _journal(
    path: Path, table: Table, columns: Sequence[Column], labels: Mapping[str, Sequence[str]]
) -> Iterator[Columns]:
    own, arrays = read_rows(path, table, BATCH_ROWS)
    places = {name: _places(own[name], known) for name, known in labels.items()}
    for rows in arrays:
        yield {
            column.name: _coded(path, places[column.name], rows[column.name])
            if column.dtype == LABEL
            else rows[column.name]
            for column in columns
        }


def _parquet(
    path: Path, table: Table, columns: Sequence[Column], labels: Mapping[str, Sequence[str]]
) -> Iterator[Columns]:
    for batch in read_batches(path, table, [column.name for column in columns], BATCH_ROWS):
        yield {column.name: _values(path, batch.column(column.name), column, labels) for column in columns}


def _values(path: Path, values: Any, column: Column, labels: Mapping[str, Sequence[str]]) -> NDArray[Any]:
    if column.dtype != LABEL:
        return values_of(values)
    places = _places(values.dictionary.to_pylist(), labels[column.name])
    return _coded(path, places, values_of(values.indices))


def _places(own: Sequence[str], known: Sequence[str]) -> NDArray[np.intp]:
    """Where each of the file's names is in our list; -1 if it is not there, which is wrong only in a row."""
    if isinstance(known, list):
        known += [name for name in own if name not in known]
    place = {name: index for index, name in enumerate(known)}
    return np.array([place.get(name, -1) for name in own], dtype=np.intp)


def _coded(path: Path, places: NDArray[np.intp], codes: NDArray[Any]) -> NDArray[np.intp]:
    inside = not codes.size or 0 <= int(codes.min()) <= int(codes.max()) < places.size
    found = places[codes] if inside else places[:0]
    if not inside or (found < 0).any():
        raise TableError(f"{path}: a row has a name that is none of this run's")
    return found
