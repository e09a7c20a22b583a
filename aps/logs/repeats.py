"""A log that does not grow with what others do a thousand times a second. Its clock is that of the records."""

from __future__ import annotations

import logging
from typing import Final

__all__ = ["Repeats"]

WINDOW_S: Final = 10.0
SAME_MOST: Final = 10
"""How often the same line is written in that time ..."""
ALIKE_MOST: Final = 300
"""... and how many lines of one kind, which differ in what they name."""


class Repeats(logging.Filter):
    """Of lines that come again and again, the first of every ten seconds are written, and how many were not.

    It belongs to one handler: who reads one file misses nothing for what is in another.

    Args:
        loggers: whose lines, by the first part of their names; the others' are all written.
    """

    def __init__(self, *loggers: str) -> None:
        super().__init__()
        self._loggers = frozenset(loggers)
        self._since_s = 0.0
        self._same: dict[tuple[str, str], int] = {}
        self._alike: dict[tuple[str, str], int] = {}
        self._left_out: dict[tuple[str, str], int] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether a record is written."""
        if record.name.partition(".")[0] not in self._loggers:
            return True
        if not self._since_s <= record.created < self._since_s + WINDOW_S:
            self._since_s = record.created
            self._same.clear()
            self._alike.clear()
        kind = record.name, str(record.msg)
        alike = self._alike.get(kind, 0)
        text = (record.name, record.getMessage()) if alike < ALIKE_MOST else kind
        same = self._same.get(text, 0)
        if alike >= ALIKE_MOST or same >= SAME_MOST:
            if len(self._left_out) < ALIKE_MOST or kind in self._left_out:
                self._left_out[kind] = self._left_out.get(kind, 0) + 1
            return False
        self._alike[kind], self._same[text] = alike + 1, same + 1
        left_out = self._left_out.pop(kind, 0)
        if left_out:
            record.msg, record.args = f"{text[1]} ({left_out} more lines like it were left out)", ()
        return True
