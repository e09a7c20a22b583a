"""All tables of a run, and their turn from journals to Parquet when it is over."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Final

from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.journal import names_path
from bridge.record.tables.logged import write_logged
from bridge.record.tables.measurements import MEASUREMENTS
from bridge.record.tables.parquet import OnProgress, write_parquet
from bridge.record.tables.routes import ROUTES
from bridge.record.tables.schema import Table
from bridge.record.tables.states import STATES
from bridge.record.tables.truth import TRUTH

TABLES: Final = (TRUTH, STATES, MEASUREMENTS, DELIVERIES, ROUTES)
"""In the order of cause."""


def finish_tables(run: Path, on_progress: OnProgress = lambda _name, _rows: None) -> None:
    """Turn journals of the run in ``run``, and what agents logged, into Parquet; its processes have to be gone.

    Args:
        run: the run directory.
        on_progress: called now and then with the table's name and how many rows are done.

    Raises:
        ValueError: a journal, or what an agent logged, cannot be read.
        OSError: a file cannot be read or written.
    """
    for table in TABLES:
        with _alone(table.journals(run)):
            _finish(run, table, on_progress)
    write_logged(run)


def _finish(run: Path, table: Table, on_progress: OnProgress) -> None:
    journals = table.journals(run)
    if journals and not table.parquet_path(run).exists():
        write_parquet(run, table, on_progress)
    for journal in reversed(journals):  # the locked one last
        journal.unlink()
        names_path(journal).unlink(missing_ok=True)
    if journals and table.by_node:
        journals[0].parent.rmdir()


@contextmanager
def _alone(journals: Sequence[Path]) -> Iterator[None]:
    """Have a lock on the first of a table's journals: another process that finishes the table is waited for."""
    with ExitStack() as stack:
        if journals:
            with suppress(OSError):  # the other one has just removed it; or a file system without locks
                fcntl.flock(stack.enter_context(journals[0].open("r+b")), fcntl.LOCK_EX)
        yield
