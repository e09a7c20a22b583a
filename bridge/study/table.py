"""The table of a study: a row per run, with its labels and what was measured of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from bridge.study.model import StudyError

TABLE_FILE = "metrics.parquet"


def write_table(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Write rows in their order; columns in the order in which they first appear, empty where a row has none.

    Raises:
        StudyError: a column has values of several kinds.
        OSError: the file cannot be written.
    """
    names = dict.fromkeys(name for row in rows for name in row)
    columns = {}
    for name in names:
        values = [row.get(name) for row in rows]
        try:
            columns[name] = pa.array([_as_double(values, value) for value in values])
        except (pa.ArrowInvalid, pa.ArrowTypeError) as error:
            raise StudyError(f"column {name} has values of several kinds: {error}") from error
    part = path.with_suffix(".part")
    pq.write_table(pa.table(columns), part, compression="zstd")
    part.replace(path)


def _as_double(values: Sequence[Any], value: Any) -> Any:
    """A whole number as a double, if the column has others too."""
    if (
        isinstance(value, int)
        and not isinstance(value, bool)
        and any(isinstance(other, float) for other in values)
    ):
        return float(value)
    return value
