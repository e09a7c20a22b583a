"""What others do a thousand times a second does not fill the log."""

from __future__ import annotations

import logging

from aps.logs.repeats import Repeats


def written(lines: list[tuple[float, str, str, tuple[object, ...]]]) -> list[str]:
    """The lines of (instant, logger, text, arguments) that are written."""
    repeats, kept = Repeats("aps", "uvicorn"), []
    for created_s, name, text, arguments in lines:
        record = logging.LogRecord(name, logging.INFO, "", 0, text, arguments, None)
        record.created = created_s
        if repeats.filter(record):
            kept.append(record.getMessage())
    return kept


def test_the_same_line_is_written_ten_times_in_ten_seconds_and_then_how_many_there_were() -> None:
    lines = [(100.0 + n / 100.0, "aps.api", "%s sends too much", ("A",)) for n in range(1200)]
    kept = written(lines)
    assert kept[:10] == ["A sends too much"] * 10
    assert kept[10] == "A sends too much (990 more lines like it were left out)"
    assert len(kept) == 20


def test_lines_that_differ_are_written_up_to_a_bound() -> None:
    kept = written([(5.0, "uvicorn.error", "client %s left", (n,)) for n in range(100_000)])
    assert kept == [f"client {n} left" for n in range(300)]


def test_another_line_and_what_agents_log_themselves_are_written() -> None:
    flood = [(5.0, "aps.hub", "again", ())] * 50
    own = [(5.0, "my_agent", "tick", ())] * 50
    assert written([*flood, (5.0, "aps.hub", "news", ()), *own])[10:] == ["news", *["tick"] * 50]
