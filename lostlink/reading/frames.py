"""Columns and tables as pandas has them. pandas is imported here, and only when a frame is asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

NS_PER_S = 1e9


def _pandas() -> Any:
    try:
        import pandas
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "data frames need pandas: pip install 'lostlink[pandas]'; without it there are Run.columns (numpy), "
            "Run.table (pyarrow) and StudyResult.rows"
        ) from error
    return pandas


def frame_of_table(table: pa.Table, time: str = "") -> pd.DataFrame:
    """An Arrow table as a frame; its names as categories. ``time``: as in `frame_of_columns`."""
    _pandas()
    frame: pd.DataFrame = table.to_pandas(use_threads=False)  # Arrow's own can abort a process that ends
    return _with_seconds(frame, time)


def frame_of_columns(columns: Mapping[str, NDArray[Any]], time: str = "") -> pd.DataFrame:
    """Columns as a frame.

    Args:
        columns: by name, of one length.
        time: a column of sim time in ns that also comes first, in seconds, as ``sim_time_s``.
    """
    return _with_seconds(_pandas().DataFrame(dict(columns)), time)


def frame_of_rows(rows: Sequence[Mapping[str, Any]], columns: Sequence[str], time: str = "") -> pd.DataFrame:
    """Rows as a frame with at least ``columns``; what a row lacks is missing. ``time``: as in `frame_of_columns`."""
    names = dict.fromkeys(columns) | dict.fromkeys(name for row in rows for name in row)
    return _with_seconds(_pandas().DataFrame(list(rows), columns=list(names)), time)


def _with_seconds(frame: pd.DataFrame, time: str) -> pd.DataFrame:
    if time:
        frame.insert(0, "sim_time_s", frame[time] / NS_PER_S)
    return frame
