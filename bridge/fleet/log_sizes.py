"""Logs of a run that grow large: what agents print is kept, whatever it is."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

LARGE_BYTES = 50_000_000


class LogSizes:
    """Looks at the logs of a run.

    Args:
        folder: of the logs.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._wanted: dict[str, int] = {}
        """Bytes from which on a log is told of again."""

    def told(self) -> Iterator[str]:
        """What to say of logs that are large; of each again when it has ten times as much."""
        for file in sorted(self._folder.glob("*.log")):
            try:
                size = file.stat().st_size
            except OSError:
                continue  # somebody has removed it
            wanted = self._wanted.get(file.name, LARGE_BYTES)
            if size >= wanted:
                self._wanted[file.name] = 10 * wanted
                yield f"{file} has {size / 1e6:.0f} MB by now: all that is printed and logged there is kept"
