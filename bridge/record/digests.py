"""One SHA-256 per stream and table of a run, and one over all: two runs with the same line did the same.

A digest is that of the file, which holds nothing of wall time: ``sha256sum`` gives the same; of a packed stream that of
what it holds (``zstdcat FILE | sha256sum``).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

from bridge.record.names import streams_of
from bridge.record.streams import open_stream
from bridge.record.tables.every import TABLES


def digests(run: Path) -> dict[str, str]:
    """SHA-256 (hex) by name of stream or table, of the Parquet file; what is not there is left out.

    Raises:
        OSError: a file cannot be read.
        ValueError: there is a stream file with a foreign name, or one that is damaged.
    """
    found = {str(stream): stream_digest(stream.path(run)) for stream in streams_of(run)}
    paths = {table.name: table.parquet_path(run) for table in TABLES}
    found |= {name: file_digest(path) for name, path in paths.items() if path.exists()}
    return found


def digest_line(mapping: Mapping[str, str]) -> str:
    """SHA-256 (hex) over all of ``mapping``, sorted by name."""
    text = "".join(f"{name} {digest}\n" for name, digest in sorted(mapping.items()))
    return hashlib.sha256(text.encode()).hexdigest()


def file_digest(path: Path) -> str:
    """SHA-256 (hex) of a file of any size.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def stream_digest(path: Path) -> str:
    """SHA-256 (hex) of a stream, packed or not.

    Raises:
        OSError: it cannot be read.
        ValueError: it is damaged.
    """
    with open_stream(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def digest_if_readable(path: Path) -> str:
    """SHA-256 (hex) of a file; "" if it cannot be read."""
    try:
        return digest_now(path)
    except OSError:
        return ""


def digest_now(path: Path) -> str:
    """As `file_digest`, which looks into a file again only if its size or the time of its last change is another.

    Raises:
        OSError: it cannot be read.
    """
    about = path.stat()
    return _digest_at(path, about.st_mtime_ns, about.st_ctime_ns, about.st_size)


@lru_cache(maxsize=4096)
def _digest_at(path: Path, *_stamp: int) -> str:
    return file_digest(path)
