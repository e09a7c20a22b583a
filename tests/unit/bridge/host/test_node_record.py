"""The record of one node: what is in which file, and from when on it is there."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import pytest

from bridge.bus.messages import AgentStatus, AircraftState, CommandGoal, Header, Vector3
from bridge.host.node_record import NodeRecord
from bridge.record import names
from bridge.record.events import AGENT_BLOCKED, AGENT_WARNING, OTHER_SYSTEM, Reports, RunEvent, read_reports
from bridge.record.inputs.file import InputError, RecordedInput, read_inputs
from bridge.record.logged import LoggedValue, decode_logged
from bridge.record.streams import Entry, read_stream
from bridge.record.tables.reader import read_columns
from bridge.record.tables.schema import NED
from bridge.record.tables.states import STATES
from bridge.run.directory import RUN_FILE, RunDirectory, RunInfo

TICK_NS = 50_000_000
ARM = RecordedInput.command(TICK_NS, "arm", CommandGoal())


def run_in(path: Path, replay: Path | None = None) -> RunDirectory:
    path.mkdir(exist_ok=True)
    info = RunInfo(path.name, "tcp/127.0.0.1:1", 1, str(replay) if replay else "")
    (path / RUN_FILE).write_text(json.dumps(asdict(info)))
    return RunDirectory(path)


@pytest.fixture
def run(tmp_path: Path) -> RunDirectory:
    return run_in(tmp_path / "run")


def mavlink_of(run: RunDirectory) -> tuple[list[Entry], list[Entry]]:
    streams = (names.from_autopilot("3"), names.to_autopilot("3"))
    heard, said = (list(read_stream(stream.path(run.path))) for stream in streams)
    return heard, said


def test_mavlink_goes_to_its_streams_with_its_instant(run: RunDirectory) -> None:
    record = NodeRecord(run, "3")
    record.write_mavlink("from_autopilot", b"boot")
    record.now_ns = TICK_NS
    record.write_mavlink("from_autopilot", b"heard")
    record.write_mavlink("to_autopilot", b"said")
    record.close({}, {})
    assert mavlink_of(run) == ([(0, b"boot"), (TICK_NS, b"heard")], [(TICK_NS, b"said")])
    assert [str(stream) for stream in names.streams_of(run.path)] == [
        "logged/3",
        "mavlink/3/from_autopilot",
        "mavlink/3/to_autopilot",
    ]


def test_states_and_what_the_agent_logs_are_there_after_a_flush(run: RunDirectory) -> None:
    record = NodeRecord(run, "3")
    state = AircraftState(
        Header.at(TICK_NS, "3"),
        mav_id=4,
        latitude_deg=40.5,
        position_ned_m=Vector3(1.0, 2.0, -3.0),
        mode="AUTO",
    )
    logged = [LoggedValue("error_m", 0.5), AgentStatus(Header.at(TICK_NS, "3"), "climbs", sent=3)]
    record.now_ns = TICK_NS
    record.write_state(state)
    for item in logged:
        record.write_logged(item)
    record.flush()
    states = read_columns(run.path, STATES)
    found = {name: states[name].tolist() for name in ("tick_ns", "node", "mav_id", "latitude_deg", "mode")}
    assert found == {
        "tick_ns": [TICK_NS],
        "node": ["3"],
        "mav_id": [4],
        "latitude_deg": [40.5],
        "mode": ["AUTO"],
    }
    assert [states[f"position_{axis}_m"][0] for axis in NED] == [1.0, 2.0, -3.0]
    entries = list(read_stream(names.logged("3").path(run.path)))
    assert [(e.tick_ns, decode_logged(e.payload)) for e in entries] == [(TICK_NS, item) for item in logged]
    record.close({}, {})


def test_inputs_are_there_at_once_and_only_if_there_are_any(run: RunDirectory) -> None:
    record = NodeRecord(run, "3")
    path = names.inputs_path(run.path, "3")
    assert not path.exists()
    opened = RecordedInput.opened(2 * TICK_NS, 1)
    record.write_input(ARM)
    record.write_input(opened)
    assert read_inputs(path) == [ARM, opened]
    with pytest.raises(InputError, match="goes back"):
        record.write_input(ARM)
    record.close({}, {})
    assert read_inputs(path) == [ARM, opened]


def test_a_run_that_repeats_no_other_has_no_inputs_to_repeat(run: RunDirectory) -> None:
    record = NodeRecord(run, "3")
    assert record.replay is None
    record.close({}, {})


def test_the_inputs_to_repeat_are_those_of_the_same_node(run: RunDirectory, tmp_path: Path) -> None:
    before = NodeRecord(run, "3")
    before.write_input(ARM)
    before.close({}, {})
    again = run_in(tmp_path / "again", run.path)
    for node, inputs in (("3", [ARM]), ("4", [])):
        record = NodeRecord(again, node)
        assert record.replay == inputs
        record.close({}, {})


def test_inputs_that_are_not_in_order_are_refused(run: RunDirectory, tmp_path: Path) -> None:
    path = names.inputs_path(run.path, "3")
    path.parent.mkdir()
    path.write_text('{"tick_ns": 50000000, "kind": "close", "link": 1}\n')
    with pytest.raises(InputError, match="link 1 is not open"):
        NodeRecord(run_in(tmp_path / "again", run.path), "3")


def test_a_reason_is_told_with_its_node_and_instant_and_counts_once(run: RunDirectory) -> None:
    record = NodeRecord(run, "3")
    record.now_ns = 25 * TICK_NS
    record.may_not_repeat("its autopilot does not read")
    record.now_ns = 26 * TICK_NS
    record.may_not_repeat("its autopilot does not read")  # a lasting cause must not fill the report
    record.close({}, {})
    text = "node 3: its autopilot does not read"
    assert read_reports(run.path) == Reports(
        {"node-3": {}},
        (RunEvent(25 * TICK_NS, "3", "wall_time", text),),
        (f"{text} (at 1.25 s)",),
    )


def test_what_somebody_must_see_is_an_event_and_told_at_once(run: RunDirectory) -> None:
    record, told = NodeRecord(run, "3"), list[RunEvent]()
    record.on_warning = told.append
    record.now_ns = TICK_NS
    record.agent_blocked("it has been at work")
    assert read_reports(run.path).events == tuple(told)  # no other tick may come
    record.other_system(7)
    record.warn("put await before it")
    assert [event.kind for event in told] == [AGENT_BLOCKED, OTHER_SYSTEM, AGENT_WARNING]
    record.close({}, {})
    assert read_reports(run.path).events == tuple(told)


def test_counters_are_flat_and_without_zeros_and_what_is_no_count(run: RunDirectory) -> None:
    record = NodeRecord(run, "3")
    statistics = {
        "autopilot": {"connections": 1, "framer": {"frames": 7, "bad_crc": 0}, "name": "x"},
        "turned_away": 2,
        "is_up": True,
        "failure": None,
        "clients": [{"frames": 3}],
    }
    record.close(statistics, {"commands_dropped": 0})
    assert read_reports(run.path).counters["node-3"] == {
        "commands_dropped": 0,
        "mavlink.autopilot.connections": 1,
        "mavlink.autopilot.framer.frames": 7,
        "mavlink.turned_away": 2,
    }


def test_what_was_flushed_is_there_without_a_close(run: RunDirectory) -> None:
    record = NodeRecord(run, "3")
    record.write_mavlink("from_autopilot", b"heard")
    record.write_mavlink("to_autopilot", b"said")
    record.may_not_repeat("of wall time")
    assert mavlink_of(run) == ([], [])
    assert read_reports(run.path).counters == {}
    record.flush()
    assert mavlink_of(run) == ([(0, b"heard")], [(0, b"said")])
    assert read_reports(run.path).may_not_repeat == ("node 3: of wall time (at 0.00 s)",)
    record.close({}, {})
