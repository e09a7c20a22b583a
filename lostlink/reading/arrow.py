"""Whole tables of a run as Arrow: from Parquet, or from what their journals have so far."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.columns import numbers, texts
from bridge.record.tables.parquet import read_table
from bridge.record.tables.schema import Column, Table, TableError

if TYPE_CHECKING:
    import pyarrow as pa


def columns_of(run: Path, table: Table, columns: Sequence[str] | None = None) -> dict[str, NDArray[Any]]:
    """A table's columns, whole, as numpy arrays; names as text. Cheaper with few ``columns``.

    Raises:
        TableError: the run has no such table or column, or it is damaged.
        OSError: it cannot be read.
    """
    chosen = _chosen(table, columns)
    names = [column.name for column in chosen]
    batches = list(read_table(run, table, names))
    if not batches:
        return {column.name: np.empty(0, dtype=_empty_type(column)) for column in chosen}
    return {name: np.concatenate([batch[name] for batch in batches]) for name in names}


def arrow_of(run: Path, table: Table, columns: Sequence[str] | None = None) -> pa.Table:
    """A table, whole, as an Arrow table; names are dictionary-encoded.

    Raises:
        TableError: the run has no such table or column, or it is damaged.
        OSError: it cannot be read.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    chosen = _chosen(table, columns)
    path = table.parquet_path(run)
    if path.exists():
        try:
            found = pq.read_table(path, columns=[column.name for column in chosen], use_threads=False)
            return found.unify_dictionaries().combine_chunks()
        except (pa.ArrowException, OSError) as error:
            raise TableError(f"{path}: damaged: {error}") from error
    values = columns_of(run, table, columns)
    return pa.table({column.name: _array(column, values[column.name]) for column in chosen})


def _chosen(table: Table, columns: Sequence[str] | None) -> list[Column]:
    if columns is None:
        return list(table.columns)
    by_name = {column.name: column for column in table.columns}
    unknown = [name for name in columns if name not in by_name]
    if unknown:
        raise TableError(f"{table.name} has no column {', '.join(unknown)}; there are {', '.join(by_name)}")
    return [by_name[name] for name in columns]


def _empty_type(column: Column) -> Any:
    return object if column.is_name else column.dtype


def _array(column: Column, values: NDArray[Any]) -> pa.Array:
    import pyarrow as pa

    if not column.is_name:
        return numbers(values)
    names, places = np.unique(values.astype(str), return_inverse=True)
    return pa.DictionaryArray.from_arrays(places.astype(np.int16), texts(names.tolist()))
