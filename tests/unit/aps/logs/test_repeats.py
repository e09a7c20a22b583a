"""What others do a thousand times a second does not fill the log."""

from __future__ import annotations

import io
import logging
from pathlib import Path

import pytest

from aps.logs.repeats import Repeats

Line = tuple[float, str, str, tuple[object, ...]]


class Kept(logging.Handler):
    """Keeps the lines that it is to write."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []
        self.is_closed = False

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(self.format(record))

    def close(self) -> None:
        self.is_closed = True
        super().close()


def record_of(line: Line) -> logging.LogRecord:
    created_s, name, text, arguments = line
    record = logging.LogRecord(name, logging.INFO, "", 0, text, arguments, None)
    record.created = created_s
    return record


def written(lines: list[Line], *, to_the_end: bool = False) -> list[str]:
    """The lines of (instant, logger, text, arguments) that are written, also at the end."""
    kept = Kept()
    repeats = Repeats(kept, "aps", "uvicorn")
    for line in lines:
        repeats.handle(record_of(line))
    before = list(kept.lines)
    repeats.close()
    assert kept.is_closed
    return kept.lines if to_the_end else before


def test_the_same_line_is_written_ten_times_in_ten_seconds_and_then_how_many_there_were() -> None:
    lines: list[Line] = [(100.0 + n / 100.0, "aps.api", "%s sends too much", ("A",)) for n in range(1200)]
    kept = written(lines)
    assert kept[:10] == ["A sends too much"] * 10
    assert kept[10] == "A sends too much (990 more lines like it were left out)"
    assert len(kept) == 20


def test_lines_that_differ_are_written_up_to_a_bound() -> None:
    kept = written([(5.0, "uvicorn.error", "client %s left", (n,)) for n in range(100_000)])
    assert kept == [f"client {n} left" for n in range(300)]


def test_another_line_and_what_agents_log_themselves_are_written() -> None:
    flood: list[Line] = [(5.0, "aps.hub", "again", ())] * 50
    own: list[Line] = [(5.0, "my_agent", "tick", ())] * 50
    assert written([*flood, (5.0, "aps.hub", "news", ()), *own])[10:] == ["news", *["tick"] * 50]


def test_what_was_left_out_and_does_not_come_again_is_counted_at_the_end() -> None:
    flood: list[Line] = [(5.0, "aps.hub", "%s again", ("A",))] * 50
    assert written(flood, to_the_end=True)[10:] == ["40 more lines like this were left out: A again"]
    assert written(flood[:10], to_the_end=True) == ["A again"] * 10


def test_lines_are_counted_by_what_they_say() -> None:
    lines: list[Line] = [(5.0, "aps.hub", "%s: %s", ("velocity", "superseded"))] * 70
    lines += [(6.0, "aps.hub", "%s: %s", ("velocity", "interrupted"))] * 12
    lines += [(20.0, "aps.hub", "%s: %s", ("velocity", "interrupted"))]
    assert written(lines, to_the_end=True) == [
        *["velocity: superseded"] * 10,
        *["velocity: interrupted"] * 10,
        "velocity: interrupted (2 more lines like it were left out)",
        "60 more lines like this were left out: velocity: superseded",
    ]


def test_lines_that_differ_are_counted_with_the_last_that_was_written() -> None:
    lines: list[Line] = [(5.0, "aps.hub", "client %s left", (n,)) for n in range(500)]
    assert written(lines, to_the_end=True)[300:] == [
        "200 more lines of this kind were left out: client 299 left"
    ]
    later: Line = (20.0, "aps.hub", "client %s left", (7,))
    assert written([*lines, later])[300:] == ["client 7 left (200 more lines of its kind were left out)"]


def test_the_count_is_written_to_a_file_when_it_is_closed(tmp_path: Path) -> None:
    repeats = Repeats(logging.FileHandler(tmp_path / "log", delay=True), "aps")
    repeats.setFormatter(logging.Formatter("%(levelname)s %(name)s: %(message)s"))
    for _ in range(12):
        repeats.handle(record_of((5.0, "aps.hub", "again", ())))
    repeats.close()
    repeats.close()
    *lines, last = (tmp_path / "log").read_text().splitlines()
    assert lines == ["INFO aps.hub: again"] * 10
    assert last == "INFO aps.hub: 2 more lines like this were left out: again"


def test_another_handler_gets_the_record_as_it_was_logged() -> None:
    kept, other = Kept(), Kept()
    repeats = Repeats(kept, "aps")
    for n in range(31):
        record = record_of((5.0 if n < 30 else 20.0, "aps.hub", "%s again", ("A",)))
        repeats.handle(record)
        other.handle(record)
        assert (record.msg, record.args) == ("%s again", ("A",))
    assert kept.lines[-1] == "A again (20 more lines like it were left out)"
    assert other.lines == ["A again"] * 31


def test_arguments_that_do_not_fit_are_told_as_logging_does(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(logging, "raiseExceptions", True)
    stream = io.StringIO()
    logger = logging.Logger("aps.hub")
    logger.addHandler(Repeats(logging.StreamHandler(stream), "aps"))
    for _ in range(50):
        logger.info("%d frames of %s", "many")
    logger.info("news")
    assert stream.getvalue() == "news\n"
    assert capsys.readouterr().err.count("--- Logging error ---") == 10
