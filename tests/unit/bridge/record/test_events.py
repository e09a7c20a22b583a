"""What processes report is merged, whole whenever it is read, and nothing that was lost stays untold."""

from __future__ import annotations

import json
import threading
from pathlib import Path

import pytest

from bridge.record.events import EVENTS_MAX, NOT_KEPT, UNREADABLE, Report, RunEvent, read_reports
from bridge.record.names import report_path


def test_reports_of_all_processes_are_merged(tmp_path: Path) -> None:
    physics, host = Report(tmp_path, "physics"), Report(tmp_path, "host-0")
    physics.event(12_300_000_000, "1", "stalled", "no answer for 5 s of wall time")
    physics.may_not_repeat("UA 1 was let go at 12.30 s")
    host.event(1, "0", "agent_error", "ZeroDivisionError")
    host.may_not_repeat("UA 1 was let go at 12.30 s")
    host.count("frames", 2)
    host.count("frames")
    host.set_counters({"frames": 7, "dropped": 1})
    physics.close()
    host.close()
    reports = read_reports(tmp_path)
    assert reports.counters == {"host-0": {"dropped": 1, "frames": 7}, "physics": {}}
    assert [event.text for event in reports.events] == ["ZeroDivisionError", "no answer for 5 s of wall time"]
    assert reports.may_not_repeat == ("UA 1 was let go at 12.30 s",)
    assert json.loads(json.dumps(reports.as_dict()))["events"][0] == {
        "sim_time_ns": 1,
        "node": "0",
        "kind": "agent_error",
        "text": "ZeroDivisionError",
    }


def test_file_has_the_documented_form(tmp_path: Path) -> None:
    report = Report(tmp_path, "physics")
    report.event(5, "1", "stalled", "x")
    report.flush()
    assert json.loads(report_path(tmp_path, "physics").read_text()) == {
        "counters": {},
        "events": [{"sim_time_ns": 5, "node": "1", "kind": "stalled", "text": "x"}],
        "may_not_repeat": [],
    }


def test_flush_writes_what_is_new_and_only_then(tmp_path: Path) -> None:
    report = Report(tmp_path, "p")
    report.flush()
    path = report_path(tmp_path, "p")
    path.unlink()
    report.flush()
    assert not path.exists()
    report.count("n")
    report.flush()
    assert read_reports(tmp_path).counters == {"p": {"n": 1}}


def test_what_could_not_be_written_is_written_later(tmp_path: Path) -> None:
    (tmp_path / "reports").write_text("in the way")
    report = Report(tmp_path, "p")
    report.count("n")
    with pytest.raises(OSError, match="reports"):
        report.flush()
    (tmp_path / "reports").unlink()
    report.flush()
    assert read_reports(tmp_path).counters == {"p": {"n": 1}}


def test_events_are_bounded_and_the_rest_is_counted(tmp_path: Path) -> None:
    report = Report(tmp_path, "p")
    for i in range(EVENTS_MAX + 5):
        report.event(i, "", "k", "t")
    report.close()
    reports = read_reports(tmp_path)
    assert len(reports.events) == EVENTS_MAX
    assert reports.counters["p"] == {NOT_KEPT: 5}


def test_threads_lose_no_count_and_the_file_is_whole_at_any_time(tmp_path: Path) -> None:
    report = Report(tmp_path, "p")

    def work() -> None:
        for i in range(300):
            report.count("n")
            if i % 30 == 0:
                report.flush()
                assert read_reports(tmp_path).events == ()

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    report.close()
    assert read_reports(tmp_path).counters == {"p": {"n": 1200}}


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        '{"counters": {}}',
        '{"counters": 1, "events": [], "may_not_repeat": []}',
        '{"counters": {"a": Infinity}, "events": [], "may_not_repeat": []}',
        '{"counters": {}, "events": [1], "may_not_repeat": []}',
        '{"counters": {}, "events": [], "may_not_repeat": null}',
    ],
)
def test_unreadable_report_becomes_an_event(tmp_path: Path, text: str) -> None:
    Report(tmp_path, "good").close()
    report_path(tmp_path, "bad").write_text(text)
    reports = read_reports(tmp_path)
    assert list(reports.counters) == ["good"]
    (event,) = reports.events
    assert isinstance(event, RunEvent)
    assert event.kind == UNREADABLE
    assert "bad.json: cannot be read" in event.text


def test_run_without_reports_has_none(tmp_path: Path) -> None:
    assert read_reports(tmp_path).as_dict() == {"counters": {}, "events": (), "may_not_repeat": ()}


def test_events_of_one_instant_are_by_node_whichever_process_told_first(tmp_path: Path) -> None:
    for process, nodes in (("physics", ("10", "2")), ("another", ("", "0"))):
        report = Report(tmp_path, process)
        for node in nodes:
            report.event(5, node, "joined", process)
            report.event(5, node, "left", process)
        report.close()
    told = [(event.node, event.kind) for event in read_reports(tmp_path).events]
    assert told == [(node, kind) for node in ("", "0", "2", "10") for kind in ("joined", "left")]
