"""The end of a run's streams: each a quarter as large, with the same content."""

from __future__ import annotations

from pathlib import Path

from bridge.record.names import streams_of
from bridge.record.streams import pack_stream


def pack_streams(run: Path) -> None:
    """Pack what the run in ``run`` left of streams; its processes have to be gone.

    Raises:
        OSError: one cannot be packed; it and those after it stay as they are, to be read as before.
        ValueError: there is a stream file with a foreign name.
    """
    for stream in streams_of(run):
        if stream.path(run).exists():
            pack_stream(stream.path(run))
