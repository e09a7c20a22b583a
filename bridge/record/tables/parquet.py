"""Tables as Parquet: a journal becomes one file when its run is over.

The bytes of a file follow from its rows alone: row groups have a fixed number of rows, and nothing of wall time is in
it. pyarrow is imported where it is used: no process of a running simulation needs it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.columns import name_type, names, numbers, texts, values_of
from bridge.record.tables.journals import rows_of
from bridge.record.tables.schema import LABEL, NUMBER, Column, Table, TableError
from bridge.run.whole_file import whole_file

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

GROUP_ROWS: Final = 1 << 17
DICTIONARY_MAX_BYTES: Final = 1 << 24
"""A dictionary of a column and row group may be as large: numbers in steps often recur."""
OnProgress = Callable[[str, int], object]


def write_parquet(run: Path, table: Table, on_progress: OnProgress) -> None:
    """Write a table's file from its journals, which stay.

    Raises:
        TableError: a journal cannot be read.
        OSError: a file cannot be read or written.
    """
    import pyarrow.parquet as pq

    done = 0
    as_they_are = [c.name for c in table.columns if c.dtype == NUMBER and not c.steps_per_unit]
    with (
        whole_file(table.parquet_path(run)) as partial,
        pq.ParquetWriter(
            partial,
            schema_of(table.columns),
            compression="zstd",
            use_dictionary=[c.name for c in table.columns if c.name not in as_they_are],
            dictionary_pagesize_limit=DICTIONARY_MAX_BYTES,
            column_encoding=dict.fromkeys(as_they_are, "BYTE_STREAM_SPLIT") or None,
        ) as writer,
    ):
        for batch in batches_of_journals(run, table, table.columns, GROUP_ROWS):
            writer.write_batch(batch, row_group_size=GROUP_ROWS)
            done += batch.num_rows
            on_progress(table.name, done)


def schema_of(columns: Sequence[Column]) -> pa.Schema:
    """The types of columns: names are dictionary-encoded."""
    import pyarrow as pa

    return pa.schema([(c.name, name_type() if c.is_name else pa.from_numpy_dtype(c.dtype)) for c in columns])


def batches_of_journals(
    run: Path, table: Table, columns: Sequence[Column], rows: int
) -> Iterator[pa.RecordBatch]:
    """Some columns of a table's journals, ``rows`` rows at a time.

    Raises:
        TableError: a file is not the journal of such a table, or a row has no name.
        OSError: one cannot be read.
    """
    import pyarrow as pa

    labels, arrays = rows_of(run, table, rows)
    schema = schema_of(columns)
    for each in arrays:
        try:
            values = [array_of(column, each[column.name], labels) for column in columns]
        except pa.ArrowException as error:
            raise TableError(f"{table.journal_path(run, '*')}: {error}") from error
        yield pa.record_batch(values, schema=schema)


def array_of(column: Column, values: NDArray[Any], labels: Mapping[str, Sequence[str]]) -> pa.Array:
    """A column as Arrow has it, from values as in a journal; ``labels`` has the names of those of names."""
    import pyarrow as pa

    packed = np.ascontiguousarray(values)
    if column.comes_up:
        found, first, which = np.unique(packed, return_index=True, return_inverse=True)
        order = np.argsort(first)
        places = np.argsort(order).astype(np.int16)[which]
        return pa.DictionaryArray.from_arrays(
            numbers(places), texts([labels[column.name][place] for place in found[order].tolist()])
        )
    if column.dtype == LABEL:
        return pa.DictionaryArray.from_arrays(numbers(packed), texts(labels[column.name]))
    if column.is_text:
        return names(packed.tolist())
    return numbers(packed)


def batches_of_parquet(
    path: Path, table: Table, columns: Sequence[Column], rows: int
) -> Iterator[pa.RecordBatch]:
    """Some columns of a table's file, up to ``rows`` rows at a time: of the table's types, none missing.

    Raises:
        TableError: it is damaged, or not such a table.
        OSError: it cannot be opened.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    expected = schema_of(columns)
    with path.open("rb") as source:
        try:
            file = pq.ParquetFile(source)
            schema = file.schema_arrow
            wrong = [
                f.name for f in expected if f.name not in schema.names or schema.field(f.name).type != f.type
            ]
            if wrong:
                raise TableError(f"{path}: no such column as in {table.name}: {', '.join(wrong)}")
            for batch in _batches(file, rows, expected.names):
                gaps = [name for name in expected.names if _has_gap(batch.column(name))]
                if gaps:
                    raise TableError(f"{path}: a row has no value in {', '.join(gaps)}")
                _check_most(path, columns, batch)
                yield batch.select(expected.names)
        except (pa.ArrowException, OSError) as error:
            raise TableError(f"{path}: damaged: {error}") from error


def _batches(file: pq.ParquetFile, rows: int, names: list[str]) -> Iterator[pa.RecordBatch]:
    """Row group by row group: a reader of all of them keeps what it has read of the file to its end."""
    for group in range(file.num_row_groups):
        yield from file.iter_batches(rows, row_groups=[group], columns=names, use_threads=False)


def _check_most(path: Path, columns: Sequence[Column], batch: pa.RecordBatch) -> None:
    """Refuse numbers that no run has."""
    for column in columns:
        values = values_of(batch.column(column.name)) if column.most and batch.num_rows else np.zeros(1)
        for value in (values.min(), values.max()):
            if not 0 <= value <= column.most:
                raise TableError(f"{path}: {column.name} {value}: has to be from 0 to {column.most}")


def _has_gap(column: pa.Array) -> bool:
    import pyarrow as pa

    return bool(
        column.null_count or (isinstance(column, pa.DictionaryArray) and column.dictionary.null_count)
    )
