"""The table of a study: a row per run, with its labels and what was measured of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from bridge.run.whole_file import whole_file
from lostlink.study.model import StudyError

TABLE_FILE = "metrics.parquet"


def table_of(rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Rows in their order; columns in the order in which they first appear, empty where a row has none.

    Raises:
        StudyError: a column has values of several kinds.
    """
    names = dict.fromkeys(name for row in rows for name in row)
    columns = {}
    for name in names:
        values = [row.get(name) for row in rows]
        try:
            columns[name] = pa.array(_of_one_kind(values))
        except (pa.ArrowInvalid, pa.ArrowTypeError) as error:
            kinds = {type(value).__name__: value for value in values if value is not None}
            found = ", ".join(f"{kind} ({value!r})" for kind, value in kinds.items())
            raise StudyError(
                f"column {name} has values of several kinds: {found}: a metric has to give one kind in all runs"
            ) from error
        except OverflowError as error:
            raise StudyError(f"column {name} has a whole number of more than 64 bits: {error}") from error
    return pa.table(columns)


def write_table(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Write the table of rows.

    Raises:
        StudyError: there is none (`table_of`), or the file cannot be written.
    """
    try:
        table = table_of(rows)
        with whole_file(path) as partial:
            pq.write_table(table, partial, compression="zstd")
    except StudyError as error:
        raise StudyError(f"{error}; no table was written{_before(path)}") from error
    except OSError as error:  # of a full disk it names no file
        raise StudyError(f"{path}: {error}; no table was written{_before(path)}") from error


def _before(path: Path) -> str:
    return f", and {path} is that of before" if path.exists() else ""


def _of_one_kind(values: Sequence[Any]) -> Sequence[Any]:
    """Whole numbers as doubles, if the column has those too."""
    if not any(isinstance(value, float) for value in values):
        return values
    return [
        float(value) if isinstance(value, int) and not isinstance(value, bool) else value for value in values
    ]
