"""The table `logged`: what agents logged, a row per number or text, made from their streams when a run is over.

An empty vector or mapping has a row, too.
"""

from __future__ import annotations

import heapq
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from bridge.record.logged import LoggedValue, kind_of, logged_of
from bridge.record.names import Kind, streams_of
from bridge.record.tables.columns import name_type, names, numbers, texts
from bridge.record.tables.schema import TableError
from bridge.run.whole_file import whole_file

if TYPE_CHECKING:
    import pyarrow as pa

LOGGED_FILE: Final = "logged.parquet"
ROWS_AT_ONCE: Final = 1 << 16


class LoggedRow(NamedTuple):
    """One number or text, or an empty vector or mapping.

    Attributes:
        tick_ns: when it was logged.
        node: whose agent logged it.
        name: under which name.
        number: counts what the node logged under the name at the tick, from 0: rows of one value have the same.
        key: of a mapping its key, of a vector the place in it, of a vector in a mapping both (``to_m.0``), else "".
        kind: ``number``, ``bool`` or ``text``; ``vector`` or ``mapping`` if it is an empty one.
        value: the number, a truth value as 0 or 1; NaN of what is neither.
        text: the text; "" of what is none.
    """

    tick_ns: int
    node: str
    name: str
    number: int
    key: str
    kind: str
    value: float
    text: str


def logged_rows(run: Path) -> Iterator[LoggedRow]:
    """All values of the run in ``run``, by tick, then by node.

    Raises:
        ValueError, OSError: a stream is damaged, or cannot be read.
    """
    found = [stream.node for stream in streams_of(run) if stream.kind is Kind.LOGGED]
    nodes = sorted(found, key=lambda node: (not node.isdecimal(), len(node), node))
    return heapq.merge(*(_rows(run, node) for node in nodes), key=lambda row: row.tick_ns)


def _rows(run: Path, node: str) -> Iterator[LoggedRow]:
    now_ns, counts = -1, Counter[str]()
    for tick_ns, item in logged_of(run, node):
        if tick_ns != now_ns:
            now_ns, counts = tick_ns, Counter()
        if isinstance(item, LoggedValue):
            for key, value in leaves(item.value):
                yield LoggedRow(tick_ns, node, item.name, counts[item.name], key, *_cells(value))
            counts[item.name] += 1


def leaves(value: Any, at: str = "") -> Iterator[tuple[str, Any]]:
    """Single values, and empty vectors and mappings, with their keys as the table has them (`LoggedRow.key`)."""
    if not isinstance(value, dict | list) or not value:
        yield at, value
        return
    for key, each in value.items() if isinstance(value, dict) else enumerate(value):
        yield from leaves(each, f"{at}.{key}" if at else str(key))


def _cells(value: Any) -> tuple[str, float, str]:
    """Kind, number and text of what `leaves` gives."""
    kind = kind_of(value)
    return kind, float(value) if kind in ("number", "bool") else math.nan, value if kind == "text" else ""


def write_logged(run: Path) -> None:
    """Write the table, if agents logged anything and it is not there yet.

    Raises:
        ValueError, OSError: a stream is damaged, or a file cannot be read or written.
    """
    path = run / LOGGED_FILE
    rows = logged_rows(run)
    first = next(rows, None)
    if path.exists() or first is None:
        return
    import pyarrow.parquet as pq

    with (
        whole_file(path) as partial,
        pq.ParquetWriter(partial, _schema(), compression="zstd") as writer,
    ):
        for batch in _batches(chain([first], rows)):
            writer.write_batch(batch)


def read_logged(run: Path, columns: Sequence[str] | None = None) -> pa.Table:
    """The table, whole, as Arrow has it: its file or, without one, what its streams have so far.

    Args:
        run: the run directory.
        columns: names of columns; all of them unless given.

    Raises:
        TableError: there is no such column, or the file is damaged.
        ValueError: a stream is damaged.
        OSError: a file cannot be read.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    path, chosen = run / LOGGED_FILE, list(LoggedRow._fields if columns is None else columns)
    unknown = [name for name in chosen if name not in LoggedRow._fields]
    if unknown:
        raise TableError(
            f"logged has no column {', '.join(unknown)}; there are {', '.join(LoggedRow._fields)}"
        )
    if path.exists():
        with path.open("rb") as source:
            try:
                found = pq.ParquetFile(source).read(chosen).select(chosen)
            except (pa.ArrowException, KeyError, OSError) as error:
                raise TableError(f"{path}: damaged: {error}") from error
    else:
        found = pa.Table.from_batches(_batches(logged_rows(run)), _schema()).select(chosen)
    return found.unify_dictionaries().combine_chunks()


def _schema() -> pa.Schema:
    import pyarrow as pa

    types = (
        pa.int64(),
        name_type(),
        pa.string(),
        pa.int64(),
        pa.string(),
        name_type(),
        pa.float64(),
        pa.string(),
    )
    return pa.schema(list(zip(LoggedRow._fields, types, strict=True)))


def _batches(rows: Iterator[LoggedRow]) -> Iterator[pa.RecordBatch]:
    import pyarrow as pa

    while part := list(islice(rows, ROWS_AT_ONCE)):
        yield pa.record_batch(_columns(part), schema=_schema())


def _columns(rows: Sequence[LoggedRow]) -> list[Any]:
    ticks_ns, nodes, named, counts, keys, kinds, values, said = zip(*rows, strict=True)
    return [
        numbers(np.array(ticks_ns, dtype=np.int64)),
        names(nodes),
        texts(named),
        numbers(np.array(counts, dtype=np.int64)),
        texts(keys),
        names(kinds),
        numbers(np.array(values, dtype=np.float64)),
        texts(said),
    ]
