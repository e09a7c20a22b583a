"""What the end of a process's log says went wrong."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

ENTRY: Final = re.compile(r"\d{4}-\d\d-\d\d [\d:,]+ \S+ (DEBUG|INFO|WARNING|ERROR|CRITICAL) ")
"""How a line of our logs begins (`bridge.run.process.LogForm`)."""
WRONG: Final = {"WARNING", "ERROR", "CRITICAL"}
TRACEBACK: Final = "Traceback (most recent call last):"


def last_words(log: str, lines: int = 5) -> str:
    """The last entry of level WARNING or above, or what came after all entries; "" if there is neither.

    Of a traceback that is its last line. Of a log that is none of ours, an autopilot's say, it is the last lines.

    Args:
        log: its text, or the end of it.
        lines: no more than so many.
    """
    written = log.rstrip().splitlines()
    begins = [number for number, line in enumerate(written) if ENTRY.match(line)]
    if not begins:
        return "\n".join(_shortened(written)[-lines:])
    ends = [*begins[1:], len(written)]
    if written[begins[-1] + 1 :] and not _is_wrong(written[begins[-1]]):
        return "\n".join(_shortened(written[begins[-1] + 1 :])[-lines:])
    for begin, end in zip(reversed(begins), reversed(ends), strict=True):
        if _is_wrong(written[begin]):
            more = _shortened(written[begin + 1 : end])
            return "\n".join([written[begin], *more][:lines])
    return ""


def _is_wrong(line: str) -> bool:
    found = ENTRY.match(line)
    return found is not None and found[1] in WRONG


def _shortened(lines: Sequence[str]) -> list[str]:
    """Lines, of a traceback the last one alone."""
    return list(lines[-1:] if TRACEBACK in lines else lines)
