"""One SHA-256 per stream of a run, and one over all: two runs with the same line did the same.

A stream's digest is that of its file, which holds ticks and payloads and nothing else: ``sha256sum`` gives the same.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

from bridge.record.names import RECORD, RECORD_FILE, streams_of


def digests(run: Path) -> dict[str, str]:
    """SHA-256 (hex) by stream name, and that of `deliveries.csv` as ``record``; what is not there is left out.

    Raises:
        OSError: a file cannot be read.
        ValueError: there is a stream file with a foreign name.
    """
    found = {str(stream): file_digest(stream.path(run)) for stream in streams_of(run)}
    if (run / RECORD_FILE).exists():
        found[RECORD] = file_digest(run / RECORD_FILE)
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
