"""Tables for the rest of the world: CSV, and Parquet of a run that was killed before it had any."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.every import TABLES
from bridge.record.tables.reader import read_batches
from bridge.record.tables.schema import Column, Table, TableError


def export_csv(run: Path, folder: Path) -> list[Path]:
    """Write `truth.csv`, `states.csv` and `deliveries.csv`, of those tables that the run has; returns the files.

    Raises:
        TableError: it has none, or one is damaged.
        OSError: a file cannot be read or written.
    """
    found = [table for table in TABLES if table.is_in(run)]
    if not found:
        raise TableError(f"{run}: it has neither {', nor '.join(table.name for table in TABLES)}")
    return [_write(run, table, folder / f"{table.name}.csv") for table in found]


def _write(run: Path, table: Table, path: Path) -> Path:
    partial = path.with_suffix(".partial")
    with partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(column.name for column in table.columns)
        for batch in read_batches(run, table):
            texts = [_texts(column, batch[column.name]) for column in table.columns]
            writer.writerows(zip(*texts, strict=True))
    partial.replace(path)
    return path


def _texts(column: Column, values: NDArray[Any]) -> Iterator[Any]:
    """Numbers in steps with all decimals of a step, others with as many as tell them from their neighbours."""
    if not column.steps_per_unit:
        return iter(values.tolist())
    decimals = round(np.log10(column.steps_per_unit))
    return (f"{value:.{decimals}f}" for value in values.tolist())
