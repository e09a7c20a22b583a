"""The journal of a table: rows of a fixed length behind a header, so that every beginning of the file can be read.

A file begins with ``LLTABLE``, a zero, a uint32 length, and so many bytes of JSON: ``table``, ``columns`` (name and
numpy type of each) and ``labels`` (the names that a column of type ``<i2`` counts from 0). The rows follow, packed, in
the columns' order. All numbers are little-endian.

Names that came after the header was written are in a file beside it, ``<journal>.names``: a line of JSON each, column
and name. A name is there before the first row that has it.
"""

from __future__ import annotations

import io
import json
import os
import struct
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.record.appending import append_units
from bridge.record.tables.schema import Table, TableError

MAGIC: Final = b"LLTABLE\0"
NAMES: Final = ".names"
"""Added to the name of a journal."""
BUFFER_ROWS: Final = 8192
HEADER_MAX_BYTES: Final = 1 << 24
READ_ROWS: Final = 1 << 16
LABELS_MAX: Final = 1 << 15
_LENGTH: Final = struct.Struct("<I")
Labels = dict[str, tuple[str, ...]]


class TableWriter:
    """Appends rows to a new table of the run directory ``run``. Not for several threads at once.

    Args:
        run: the run directory.
        table: which table.
        labels: for each column of names, the names that rows have places in; more may be added at the end.
        node: whose journal it is, if each node has one.
        buffer_rows: rows that are kept before they are written.

    Raises:
        OSError: the file cannot be made or written.
        ValueError: ``labels`` are not those of the table, or a column has more than LABELS_MAX.
    """

    def __init__(
        self,
        run: Path,
        table: Table,
        labels: Mapping[str, Sequence[str]],
        node: str = "",
        buffer_rows: int = BUFFER_ROWS,
    ) -> None:
        if set(labels) != set(table.labels):
            raise ValueError(f"labels for {sorted(labels)}; {table.name} has {sorted(table.labels)}")
        most = max(map(len, labels.values()), default=0)
        if most > LABELS_MAX:
            raise ValueError(f"{table.name}: {most} names for a column; up to {LABELS_MAX} are allowed")
        self._table = table
        self._rows = np.empty(buffer_rows, dtype=table.dtype)
        self._columns = {column.name: self._rows[column.name] for column in table.columns}
        self._steps = [
            (column.name, column.steps_per_unit) for column in table.columns if column.steps_per_unit
        ]
        self._filled = 0
        self._labels = labels
        self._told = {name: len(names) for name, names in labels.items()}
        self._path = table.journal_path(run, node)
        self._path.parent.mkdir(exist_ok=True)
        self._file = io.FileIO(self._path, "w")
        header = {
            "table": table.name,
            "columns": [[column.name, column.dtype] for column in table.columns],
            "labels": {name: list(names) for name, names in labels.items()},
        }
        text = json.dumps(header).encode()
        head = MAGIC + _LENGTH.pack(len(text)) + text
        append_units(self._file, head, len(head))

    def append(self, rows: int, **columns: ArrayLike) -> None:
        """Append so many rows; they are on disk after `flush` or `close`.

        Args:
            rows: how many.
            columns: all columns of the table: arrays of that length, or one value for all rows.

        Raises:
            ValueError: a column is missing, or there is no such column, or it has another length.
            TypeError: numbers of another kind than the column's.
        """
        if columns.keys() != self._columns.keys():
            raise ValueError(
                f"{self._table.name}: columns {sorted(columns.keys() ^ self._columns.keys())} are missing or unknown"
            )
        values = {name: np.asarray(value) for name, value in columns.items()}
        for name, each in values.items():
            if each.shape not in ((), (rows,)):
                raise ValueError(f"{self._table.name}: {name} has the shape {each.shape}, not ({rows},)")
        done = 0
        while done < rows:
            count = min(rows - done, len(self._rows) - self._filled)
            self._fill(values, done, count)
            done += count
            if self._filled == len(self._rows):
                self.flush()

    def append_row(self, row: tuple[Any, ...]) -> None:
        """Append one row: values in the order of the columns, names as their places, text as bytes."""
        if self._filled == len(self._rows):  # they found no room on the disk
            self.flush()
        self._rows[self._filled] = row
        self._filled += 1
        if self._filled == len(self._rows):
            self.flush()

    def _fill(self, values: Mapping[str, NDArray[Any]], begin: int, count: int) -> None:
        end = self._filled + count
        for name, value in values.items():
            part = value[begin : begin + count] if value.ndim else value
            np.copyto(self._columns[name][self._filled : end], part, casting="same_kind")
        self._filled = end

    def flush(self) -> None:
        """Hand everything to the operating system, so that it is there if this process is killed."""
        if self._filled == 0:
            return
        for name, steps_per_unit in self._steps:
            column = self._columns[name][: self._filled]
            column[:] = np.rint(column * steps_per_unit) / steps_per_unit + 0.0  # a zero has no sign
        self._tell_names()
        begin, row_bytes = self._file.tell(), self._rows.itemsize
        try:
            append_units(self._file, self._rows[: self._filled].tobytes(), row_bytes)
        finally:
            written = (self._file.tell() - begin) // row_bytes
            self._rows[: self._filled - written] = self._rows[written : self._filled].copy()
            self._filled -= written

    def _tell_names(self) -> None:
        """Write down the names that were added since."""
        new = [
            [column, name] for column, names in self._labels.items() for name in names[self._told[column] :]
        ]
        if new:
            text = "".join(json.dumps(each) + "\n" for each in new).encode()
            with io.FileIO(names_path(self._path), "a") as file:
                append_units(file, text, len(text))
            self._told = {column: len(names) for column, names in self._labels.items()}

    def close(self) -> None:
        """Flush and close; a second call does nothing."""
        if not self._file.closed:
            self.flush()
            self._file.close()


def names_path(journal: Path) -> Path:
    """The file of the names that came after a journal's header."""
    return journal.with_name(journal.name + NAMES)


def read_rows(path: Path, table: Table, rows: int = READ_ROWS) -> tuple[Labels, Iterator[NDArray[np.void]]]:
    """The names of a journal, and its rows in arrays of up to ``rows``. A tail that was cut off ends it quietly.

    Rows are those that are whole now: what a writer adds meanwhile is for the next reader.

    Raises:
        TableError: it is not the journal of such a table.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        labels = _labels(path, file, table)
        begin = file.tell()
        left = (file.seek(0, os.SEEK_END) - begin) // table.dtype.itemsize
    if labels is None:
        return dict.fromkeys(table.labels, ()), iter(())
    for column, name in _added(path):  # read after the rows were counted: it has all of theirs
        if column not in labels:
            raise TableError(f"{names_path(path)}: {column!r} is no column of names in {table.name}")
        labels[column] = (*labels[column], name)
    return labels, _rows(path, begin, left, table.dtype, rows)


def _rows(
    path: Path, begin: int, left: int, dtype: np.dtype[np.void], rows: int
) -> Iterator[NDArray[np.void]]:
    with path.open("rb") as file:
        file.seek(begin)
        while left and len(found := np.fromfile(file, dtype=dtype, count=min(rows, left))):
            left -= len(found)
            yield found


def _labels(path: Path, file: BinaryIO, table: Table) -> Labels | None:
    """The names in a header; None if it was cut off."""
    start = file.read(len(MAGIC) + _LENGTH.size)
    if not (MAGIC + bytes(_LENGTH.size)).startswith(start[: len(MAGIC)]):
        raise TableError(f"{path}: not the journal of a table (it does not begin with {MAGIC[:-1].decode()})")
    if len(start) < len(MAGIC) + _LENGTH.size:
        return None
    (length,) = _LENGTH.unpack_from(start, len(MAGIC))
    if length > HEADER_MAX_BYTES:
        raise TableError(f"{path}: a header of {length} bytes; up to {HEADER_MAX_BYTES} are allowed")
    text = file.read(length)
    if len(text) < length:
        return None
    try:
        header = json.loads(text)
        columns = [(str(name), str(dtype)) for name, dtype in header["columns"]]
        labels = {str(name): tuple(map(str, names)) for name, names in header["labels"].items()}
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise TableError(f"{path}: its header cannot be read: {error}") from error
    if columns != [(c.name, c.dtype) for c in table.columns] or set(labels) != set(table.labels):
        raise TableError(f"{path}: not the columns of {table.name} as this lostlink has them")
    return labels


def _added(path: Path) -> Iterator[tuple[str, str]]:
    """Columns and names that came after the header; a line that was cut off ends them quietly."""
    added = names_path(path)
    if not added.exists():
        return
    for line in added.read_bytes().splitlines(keepends=True):
        if line.endswith(b"\n"):
            try:
                column, name = map(str, json.loads(line))
            except (ValueError, TypeError, RecursionError) as error:
                raise TableError(f"{added}: cannot be read: {error}") from error
            yield column, name


def checked_places(path: Path, names: Sequence[str], places: NDArray[Any]) -> NDArray[Any]:
    """Places in ``names``, as they are.

    Raises:
        TableError: one is outside.
    """
    if places.size and not 0 <= int(places.min()) <= int(places.max()) < len(names):
        raise TableError(f"{path}: a row has a name that the file has not")
    return places
