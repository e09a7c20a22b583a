"""A log that does not grow with what others do a thousand times a second. Its clock is that of the records."""

from __future__ import annotations

import copy
import logging
from collections.abc import Iterator
from typing import Final

WINDOW_S: Final = 10.0
SAME_MOST: Final = 10
"""How often the same line is written in that time ..."""
ALIKE_MOST: Final = 300
"""... and how many lines of one kind, which differ in what they name."""

_Lines = tuple[str, str, bool]
"""The logger's name, and a text that is the same, or what differs only in what it names."""


class Repeats(logging.Handler):
    """Of lines that come again and again, the first of every ten seconds are written, and how many were not.

    The number is written with the next line that is the same, or of lines that differ with the next of their kind; or
    when this handler closes. Other handlers get each record as it was logged.

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
        self._alike: dict[tuple[str, str], tuple[int, str]] = {}
        """How many of a kind, and the last of them that was written."""
        self._left_out: dict[_Lines, tuple[int, int, str]] = {}
        """How many, their highest level, and one of them."""

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
        alike, written = self._alike.get(kind, (0, kind[1]))
        text = _text(record) if alike < ALIKE_MOST else None
        line = kind if text is None else (record.name, text)
        same = self._same.get(line, 0)
        if alike >= ALIKE_MOST:
            self._leave_out((*kind, False), record.levelno, written)
            return
        if same >= SAME_MOST:
            self._leave_out((*line, True), record.levelno, line[1])
            return
        self._alike[kind], self._same[line] = (alike + 1, line[1]), same + 1
        if text is not None and (more := [*self._more((*line, True)), *self._more((*kind, False))]):
            record = copy.copy(record)  # the record is every handler's
            record.msg, record.args = f"{text} ({', '.join(more)} were left out)", ()
        self._handler.handle(record)

    def _leave_out(self, lines: _Lines, level: int, text: str) -> None:
        if len(self._left_out) < ALIKE_MOST or lines in self._left_out:
            count, highest, _ = self._left_out.get(lines, (0, level, ""))
            self._left_out[lines] = count + 1, max(highest, level), text

    def _more(self, lines: _Lines) -> Iterator[str]:
        """How many such lines were left out, if any were; they are not counted any more."""
        if lines in self._left_out:
            count, _, _ = self._left_out.pop(lines)
            yield f"{count} more lines {'like it' if lines[2] else 'of its kind'}"

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
        for (name, _, is_same), (count, level, text) in left_out.items():
            more = f"%d more lines {'like this' if is_same else 'of this kind'} were left out: %s"
            self._handler.handle(logging.LogRecord(name, level, "", 0, more, (count, text), None))
        self._handler.close()
        super().close()


def _text(record: logging.LogRecord) -> str | None:
    """What it says; None if its arguments do not fit: the handler then says so as logging does."""
    try:
        return record.getMessage()
    except Exception:
        return None
