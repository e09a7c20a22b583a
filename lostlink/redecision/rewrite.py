"""What was decided anew as a run directory: for `compare`, plots, studies, and whatever else reads runs."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from bridge.radio.ledger_file import LEDGER, write_ledger
from bridge.record.names import INPUT_FOLDER, REPORT_FOLDER, STREAM_FOLDER
from bridge.record.provenance import read_provenance, write_provenance
from bridge.record.tables.deliveries import DELIVERIES, DeliveryWriter, Vocabulary
from bridge.record.tables.every import TABLES, finish_tables
from bridge.record.tables.routes import ROUTES, RouteWriter
from bridge.run.directory import LOG_FOLDER, RunDirectory
from lostlink.redecision.redecide import Redecision

ROWS_AT_ONCE = 1 << 13
OnProgress = Callable[[str, int], object]
_KEPT_FOLDERS = (STREAM_FOLDER, INPUT_FOLDER, REPORT_FOLDER, LOG_FOLDER)


def check_is_free(directory: Path) -> None:
    """See that a run can go to a directory: that it is not there yet, or empty.

    Raises:
        OSError: it is not.
    """
    if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
        raise FileExistsError(f"{directory}: it is there already, and not empty")


def write_run(
    result: Redecision, directory: Path, on_progress: OnProgress = lambda _name, _rows: None
) -> RunDirectory:
    """Write ``directory``: the new deliveries and ledger, the scenario as decided, and copies of what stays as it was.

    Args:
        result: what was decided.
        directory: not there yet, or empty.
        on_progress: called now and then with what is written and how far that is.

    Raises:
        OSError: it is there already, or cannot be written.
        ValueError: the run's tables cannot be read.
    """
    check_is_free(directory)
    directory.mkdir(parents=True, exist_ok=True)
    made = RunDirectory(directory.resolve())
    made.write(result.scenario, "")
    for name in _KEPT_FOLDERS:
        if (result.run / name).is_dir():
            on_progress(name, 0)
            _copy_folder(result.run / name, directory / name)
    kept = [table for table in TABLES if table not in (DELIVERIES, ROUTES)]
    tables = (path for table in kept for path in table.files(result.run))
    for path in tables:
        if path.exists():
            copy = directory / path.relative_to(result.run)
            copy.parent.mkdir(exist_ok=True)
            shutil.copyfile(path, copy)
    if flown := read_provenance(result.run):
        write_provenance(replace(flown, files={**flown.files, **result.files}), directory)
    write_ledger(directory / LEDGER, result.books, {})
    if result.is_routed:
        radios = [each.radio for each in result.books if each.routing is not None]
        routes = RouteWriter(directory, result.after.nodes, radios)
        routes.write(result.routes)
        routes.close()
    write_deliveries(result, directory, on_progress)
    return made


def _copy_folder(folder: Path, to: Path) -> None:
    """Copy a folder with all that is in it.

    Raises:
        OSError: of the first file that cannot be read or written.
    """
    try:
        shutil.copytree(folder, to)
    except shutil.Error as error:  # has them all
        path, _, why = error.args[0][0]
        raise OSError(f"{path}: {why}") from error


def write_deliveries(
    result: Redecision, directory: Path, on_progress: OnProgress = lambda _name, _rows: None
) -> None:
    """Write the table of deliveries alone, as a run with these fates would have: byte for byte.

    Raises:
        OSError: it cannot be written.
        ValueError: a journal that lies there cannot be read.
    """
    directory.mkdir(parents=True, exist_ok=True)
    words = Vocabulary()
    writer = DeliveryWriter(
        directory, result.after.nodes, words, routed=result.is_routed, parted=result.is_parted
    )
    try:
        for begin in range(0, len(result.after), ROWS_AT_ONCE):
            part = result.after.at(slice(begin, begin + ROWS_AT_ONCE))
            writer.append(len(part), **part.columns, **result.facts.words(part.columns, words))
    finally:
        writer.close()
    finish_tables(directory, on_progress)
