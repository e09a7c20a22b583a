"""What a record had when its run ended, and has no more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from bridge.record.names import REPORT_FOLDER, Kind, Stream, streams_of
from bridge.record.streams import stream_exists
from bridge.record.tables.every import TABLES
from bridge.record.tables.logged import LOGGED_FILE
from bridge.run.directory import LOG_FOLDER
from lostlink.reading.named import named

_TABLES: Final = {table.name: table for table in TABLES}
SHOWN: Final = 6


def lost_parts(run: Path, summary: Mapping[str, Any]) -> list[str]:
    """Streams and tables that the run's summary names and its directory lacks, and folders of texts that it lacks.

    Of a run without a summary nothing is known, but that of a table `logged` there were streams.

    Raises:
        OSError, ValueError: the streams cannot be looked through.
    """
    if not isinstance(summary.get("digests"), dict):
        has_logged = any(stream.kind is Kind.LOGGED for stream in streams_of(run))
        return [Kind.LOGGED.value] if (run / LOGGED_FILE).exists() and not has_logged else []
    folders = (*([REPORT_FOLDER] if summary.get("counters") else []), LOG_FOLDER)
    lost = [name for name in sorted(summary["digests"]) if not _is_there(run, name)]
    return [*lost, *(folder for folder in folders if not (run / folder).is_dir())]


def in_words(parts: Sequence[str]) -> str:
    """Some of them, and how many more there are."""
    return named(parts, most=SHOWN)


def _is_there(run: Path, name: str) -> bool:
    if name in _TABLES:
        return _TABLES[name].is_in(run)
    try:
        return stream_exists(Stream.parse(name).path(run))
    except ValueError:
        return True  # it is no name of ours: the summary was changed
