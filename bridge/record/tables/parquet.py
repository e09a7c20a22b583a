"""Tables as Parquet: a journal becomes one file when its run is over, and either is read by column.

The bytes of a file follow from its rows alone: row groups have a fixed number of rows, and nothing of wall time is in
it. pyarrow is imported where it is used: no process of a running simulation needs it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.columns import numbers, texts, values_of
from bridge.record.tables.journals import plain, read_journals, rows_of
from bridge.record.tables.schema import LABEL, NUMBER, TABLES, Batch, Column, Table, TableError

if TYPE_CHECKING:
    import pyarrow as pa

GROUP_ROWS: Final = 1 << 17
READ_ROWS: Final = 1 << 16
DICTIONARY_MAX_BYTES: Final = 1 << 24
"""A dictionary of a column and row group may be as large: numbers in steps often recur."""
OnProgress = Callable[[str, int], object]


def finish_tables(run: Path, on_progress: OnProgress = lambda _name, _rows: None) -> None:
    """Turn what the run in ``run`` left of journals into Parquet; its processes have to be gone.

    Args:
        run: the run directory.
        on_progress: told now and then the table's name and how many rows are done.

    Raises:
        TableError: a journal cannot be read.
        OSError: a file cannot be read or written.
    """
    for table in TABLES:
        journals = table.journals(run)
        if journals and not table.parquet_path(run).exists():
            _write(table, run, on_progress)
        for journal in journals:
            journal.unlink()
        if journals and table.by_node:
            journals[0].parent.rmdir()


def _write(table: Table, run: Path, on_progress: OnProgress) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    labels, arrays = rows_of(run, table, GROUP_ROWS)
    path = table.parquet_path(run)
    partial, done = path.with_suffix(".partial"), 0
    schema = pa.schema([(column.name, _type(column)) for column in table.columns])
    as_they_are = [c.name for c in table.columns if c.dtype == NUMBER and not c.steps_per_unit]
    with pq.ParquetWriter(
        partial,
        schema,
        compression="zstd",
        use_dictionary=[c.name for c in table.columns if c.name not in as_they_are],
        dictionary_pagesize_limit=DICTIONARY_MAX_BYTES,
        column_encoding=dict.fromkeys(as_they_are, "BYTE_STREAM_SPLIT") or None,
    ) as writer:
        for rows in arrays:
            try:
                columns = [_column(column, rows[column.name], labels) for column in table.columns]
            except pa.ArrowException as error:
                raise TableError(f"{run}: {table.name}: {error}") from error
            writer.write_table(pa.table(columns, schema=schema), row_group_size=GROUP_ROWS)
            done += len(rows)
            on_progress(table.name, done)
    partial.replace(path)


def _type(column: Column) -> pa.DataType:
    import pyarrow as pa

    if column.is_name:
        return pa.dictionary(pa.int16(), pa.string())
    return pa.from_numpy_dtype(column.dtype)


def _column(column: Column, values: NDArray[Any], labels: Mapping[str, Sequence[str]]) -> pa.Array:
    import pyarrow as pa

    packed = np.ascontiguousarray(values)
    if column.dtype == LABEL:
        return pa.DictionaryArray.from_arrays(numbers(packed), texts(labels[column.name]))
    if column.is_text:
        return texts(plain(column, packed).tolist()).dictionary_encode().cast(_type(column))
    return numbers(packed)


def read_table(run: Path, table: Table, columns: Sequence[str] | None = None) -> Iterator[Batch]:
    """The rows of a table of the run in ``run``, some at a time: from Parquet, or from what its journal has so far.

    Args:
        run: the run directory.
        table: which table.
        columns: names of columns; all of them unless given.

    Raises:
        TableError: there is none, or it is damaged.
        OSError: it cannot be read.
    """
    names = tuple(columns or (column.name for column in table.columns))
    if table.parquet_path(run).exists():
        return read_parquet(table.parquet_path(run), table, names)
    if table.journals(run):
        return read_journals(run, table, names)
    raise TableError(f"{run}: it has no {table.parquet_path(run).name}, nor a journal of it")


def read_parquet(path: Path, table: Table, columns: Sequence[str]) -> Iterator[Batch]:
    """The rows of a table's Parquet file, some at a time.

    Raises:
        TableError: it is damaged, or not such a table.
        OSError: it cannot be opened.
    """
    for batch in read_batches(path, table, columns, READ_ROWS):
        yield {name: _values(batch.column(name)) for name in columns}


def read_batches(path: Path, table: Table, columns: Sequence[str], rows: int) -> Iterator[pa.RecordBatch]:
    """The rows of a table's Parquet file as Arrow, up to ``rows`` at a time: of the table's types, none missing.

    Raises:
        TableError: it is damaged, or not such a table.
        OSError: it cannot be opened.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    expected = {column.name: _type(column) for column in table.columns}
    with path.open("rb") as source:
        try:
            file = pq.ParquetFile(source)
            schema = file.schema_arrow
            missing = [n for n in columns if n not in schema.names or schema.field(n).type != expected[n]]
            if missing:
                raise TableError(f"{path}: no such column as in {table.name}: {', '.join(missing)}")
            for batch in file.iter_batches(rows, columns=list(columns), use_threads=False):
                gaps = [name for name in columns if batch.column(name).null_count]
                if gaps:
                    raise TableError(f"{path}: a row has no value in {', '.join(gaps)}")
                yield batch
        except (pa.ArrowException, OSError) as error:
            raise TableError(f"{path}: damaged: {error}") from error


def _values(column: pa.Array) -> NDArray[Any]:
    import pyarrow as pa

    if isinstance(column, pa.DictionaryArray):
        names = np.array(column.dictionary.to_pylist(), dtype=object)
        found: NDArray[Any] = names[values_of(column.indices)]
        return found
    return values_of(column)
