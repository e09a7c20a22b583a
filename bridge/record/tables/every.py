"""All tables of a run, and their turn from journals to Parquet when it is over."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.measurements import MEASUREMENTS
from bridge.record.tables.parquet import OnProgress, write_parquet
from bridge.record.tables.states import STATES
from bridge.record.tables.truth import TRUTH

TABLES: Final = (TRUTH, STATES, MEASUREMENTS, DELIVERIES)
"""In the order of cause."""


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
            write_parquet(run, table, on_progress)
        for journal in journals:
            journal.unlink()
        if journals and table.by_node:
            journals[0].parent.rmdir()
