"""Whole units at the end of a file, also on a disk that is full for a while."""

from __future__ import annotations

import io


def append_units(file: io.FileIO, data: bytes, unit_bytes: int) -> None:
    """All of it; of what finds no room on the disk whole units: behind a half one no other would be in its place.

    Args:
        file: it stands at its end.
        data: units of one length, one behind the other.
        unit_bytes: their length.

    Raises:
        OSError: it cannot be written; the file ends, and stands, behind the last unit.
    """
    begin, view = file.tell(), memoryview(data)
    try:
        while view:
            view = view[file.write(view) :]
    except OSError:
        written_bytes = len(data) - len(view)
        file.truncate(file.seek(begin + written_bytes - written_bytes % unit_bytes))
        raise
