"""A log that does not grow with what others do a thousand times a second. Its clock is that of the records."""

from __future__ import annotations

import copy
import logging
from typing import Final

__all__ = ["Repeats"]

WINDOW_S: Final = 10.0
SAME_MOST: Final = 10
"""How often the same line is written in that time ..."""
ALIKE_MOST: Final = 300
"""... and how many lines of one kind, which differ in what they name."""


class Repeats(logging.Handler):
    """Of lines that come again and again, the first of every ten seconds are written, and how many were not.

    The number is written with the next line of that kind, or when this handler closes. Other handlers get each record
    as it was logged.

    Args:
        handler: writes them; it is closed with this one.
        loggers: whose lines, by the first part of their names; the others' are all written.
    """

    def __init__(self, handler: logging.Handler, *loggers: str) -> None:
        super().__init__(handler.level)
        self._handler = handler
        self._loggers = frozenset(loggers)
        self._since_s = 0.0
        self._same: dict[tuple[str, str], int] = {}
        self._alike: dict[tuple[str, str], int] = {}
        self._left_out: dict[tuple[str, str], tuple[int, int]] = {}
        """How many of a kind, and their highest level."""

    def setFormatter(self, fmt: logging.Formatter | None) -> None:  # noqa: N802  (the name is logging's)
        """The form of the lines."""
        super().setFormatter(fmt)
        self._handler.setFormatter(fmt)

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record, or count it."""
        if record.name.partition(".")[0] not in self._loggers:
            self._handler.handle(record)
            return
        if not self._since_s <= record.created < self._since_s + WINDOW_S:
            self._since_s = record.created
            self._same.clear()
            self._alike.clear()
        kind = record.name, record.msg if isinstance(record.msg, str) else type(record.msg).__name__
        alike = self._alike.get(kind, 0)
        text = _text(record) if alike < ALIKE_MOST else None
        line = kind if text is None else (record.name, text)
        same = self._same.get(line, 0)
        if alike >= ALIKE_MOST or same >= SAME_MOST:
            self._leave_out(kind, record.levelno)
            return
        self._alike[kind], self._same[line] = alike + 1, same + 1
        if text is not None and kind in self._left_out:
            count, _ = self._left_out.pop(kind)
            record = copy.copy(record)  # the record is every handler's
            record.msg, record.args = f"{text} ({count} more lines like it were left out)", ()
        self._handler.handle(record)

    def _leave_out(self, kind: tuple[str, str], level: int) -> None:
        if len(self._left_out) < ALIKE_MOST or kind in self._left_out:
            count, highest = self._left_out.get(kind, (0, level))
            self._left_out[kind] = count + 1, max(highest, level)

    def flush(self) -> None:
        """Have what was written reach its file."""
        self._handler.flush()

    def close(self) -> None:
        """Write how many lines were left out since, and close the handler."""
        self.acquire()
        try:
            left_out, self._left_out = self._left_out, {}
        finally:
            self.release()
        for (name, text), (count, level) in left_out.items():
            more = "%d more lines like this were left out: %s"
            self._handler.handle(logging.LogRecord(name, level, "", 0, more, (count, text), None))
        self._handler.close()
        super().close()


def _text(record: logging.LogRecord) -> str | None:
    """What it says; None if its arguments do not fit: the handler then says so as logging does."""
    try:
        return record.getMessage()
    except Exception:
        return None
