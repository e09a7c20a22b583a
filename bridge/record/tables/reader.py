"""Tables read in one way: from Parquet, or from what journals have so far.

A value that is missing, a name that nobody knows and a file that is damaged are a `TableError` that names the file.
pyarrow is imported where it is used: no process of a running simulation needs it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.columns import values_of
from bridge.record.tables.journal import checked_places
from bridge.record.tables.parquet import batches_of_journals, batches_of_parquet, schema_of
from bridge.record.tables.schema import Column, Columns, Table, TableError

if TYPE_CHECKING:
    import pyarrow as pa

READ_ROWS: Final = 1 << 16
GROWS_BY: Final = 8
"""While a table is read whole, there is room for up to this part of it more."""
Names = Mapping[str, Sequence[str]]
"""For columns of names all that there may be: what is read are places in them."""
AS_TEXT: Final[Names] = MappingProxyType({})


def read_batches(
    run: Path, table: Table, columns: Sequence[str] | None = None, names: Names = AS_TEXT
) -> Iterator[Columns]:
    """The rows of a table of the run in ``run``, some at a time.

    Args:
        run: the run directory.
        table: which table.
        columns: names of columns; all of them unless given.
        names: of what columns of names are read as places; the others are read as text.

    Raises:
        TableError: there is no such table or column, the table is damaged, or has a name that ``names`` lacks.
        OSError: it cannot be read.
    """
    path, batches = _source(run, table, table.chosen(columns))
    return (
        {name: _values(path, batch.column(name), names.get(name)) for name in batch.schema.names}
        for batch in batches
    )


def read_columns(
    run: Path, table: Table, columns: Sequence[str] | None = None, names: Names = AS_TEXT
) -> Columns:
    """The columns of a table, whole. Arguments and errors as of `read_batches`."""
    whole, rows = no_rows(table, columns, names), 0
    for batch in read_batches(run, table, columns, names):
        size = len(next(iter(batch.values())))
        for name, values in batch.items():
            if rows + size > len(whole[name]):
                # Grown a little at a time: whole and parts at once would be twice the memory.
                whole[name].resize(rows + size + rows // GROWS_BY, refcheck=False)
            whole[name][rows : rows + size] = values
        rows += size
    for values in whole.values():
        values.resize(rows, refcheck=False)
    return whole


def read_arrow(run: Path, table: Table, columns: Sequence[str] | None = None) -> pa.Table:
    """A table, whole, as Arrow has it; names are dictionary-encoded. Arguments and errors as of `read_batches`."""
    import pyarrow as pa

    chosen = table.chosen(columns)
    _, batches = _source(run, table, chosen)
    return pa.Table.from_batches(batches, schema_of(chosen)).unify_dictionaries().combine_chunks()


def no_rows(table: Table, columns: Sequence[str] | None = None, names: Names = AS_TEXT) -> Columns:
    """As `read_columns`, of a table without rows."""
    return {column.name: np.empty(0, _kind(column, names)) for column in table.chosen(columns)}


def joined(parts: Sequence[Columns]) -> Columns:
    """The rows of all parts, one part behind the other."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _kind(column: Column, names: Names) -> np.dtype[Any]:
    if column.is_name:
        return np.dtype(np.intp if column.name in names else object)
    return np.dtype(column.dtype)


def _source(run: Path, table: Table, columns: Sequence[Column]) -> tuple[Path, Iterator[pa.RecordBatch]]:
    """What is read, and its rows."""
    path, journals = (
        table.parquet_path(run),
        table.journals(run),
    )  # looked for first: they go when that is there
    if path.exists():
        return path, batches_of_parquet(path, table, columns, READ_ROWS)
    if journals:
        return table.journal_path(run, "*"), _batches_of_now(run, table, columns)
    raise TableError(f"{run}: it has no {path.name}, nor a journal of it")


def _batches_of_now(run: Path, table: Table, columns: Sequence[Column]) -> Iterator[pa.RecordBatch]:
    """What journals have so far; or the whole table, if just now they become Parquet.

    They go once that is there, one by one (`bridge.record.tables.every`): so all of them were there if it is not there
    after they were opened, which is with the first rows.
    """
    path = table.parquet_path(run)
    batches = batches_of_journals(run, table, columns, READ_ROWS)
    try:
        first = next(batches, None)
    except (OSError, TableError):
        if not path.exists():
            raise
    if path.exists():
        yield from batches_of_parquet(path, table, columns, READ_ROWS)
    elif first is not None:
        yield first
        yield from batches


def _values(path: Path, column: pa.Array, known: Sequence[str] | None) -> NDArray[Any]:
    import pyarrow as pa

    if not isinstance(column, pa.DictionaryArray):
        return values_of(column)
    own = column.dictionary.to_pylist()
    codes = checked_places(path, own, values_of(column.indices))
    if known is None:
        texts: NDArray[Any] = np.array(own, dtype=object)[codes]
        return texts
    place = {name: index for index, name in enumerate(known)}
    found: NDArray[np.intp] = np.array([place.get(name, -1) for name in own], dtype=np.intp)[codes]
    if found.size and found.min() < 0:
        unknown = own[codes[found.argmin()]]
        raise TableError(f"{path}: a row has a name that is none of this run's: {unknown!r}")
    return found
