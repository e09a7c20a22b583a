"""A run read back has what its writers wrote, finished or killed."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from aps.wire.dialect import Encoder
from bridge.record.digests import digests
from bridge.record.events import Report
from bridge.record.inputs.file import InputWriter, RecordedInput
from bridge.record.logged import LoggedValue, encode_logged
from bridge.record.names import from_autopilot, inputs_path, logged, packets
from bridge.record.packets import SentPacket, encode_packet
from bridge.record.provenance import Provenance, collect, write_provenance
from bridge.record.streams import Entry
from bridge.record.tables.every import TABLES
from bridge.record.tables.schema import TableError
from bridge.record.tables.truth import TruthWriter
from bridge.run.directory import SCENARIO_FILE
from bridge.scenario.file import read_scenario
from lostlink.reading.run import NoRun, Run, load_run
from tests.unit.bridge.record.runs import TICK_NS, RunContent, heartbeat, make_run, row_at, truth_at


def write(path: Path, *, is_finished: bool = True) -> Path:
    ticks = [i * TICK_NS for i in range(40)]
    content = RunContent(
        {
            from_autopilot("0"): [Entry(tick, bytes([i])) for i, tick in enumerate(ticks)],
            packets("0"): [
                Entry(tick, encode_packet(SentPacket(i, tick, "main/all/team", b"abc")))
                for i, tick in enumerate(ticks)
            ],
        },
        [truth_at(node, tick) for tick in ticks for node in ("0", "1")],
        [row_at(tick, "0", "1") for tick in ticks],
    )
    content.write(path, is_finished=is_finished)
    (path / SCENARIO_FILE).write_text(read_scenario("separation").to_yaml(), encoding="utf-8")
    writer = InputWriter(inputs_path(path, "1"))
    writer.write(RecordedInput.opened(TICK_NS, 3))
    writer.write(RecordedInput.frame(TICK_NS, 3, heartbeat(Encoder(sysid=255, compid=190))))
    writer.close()
    report = Report(path, "physics")
    report.event(5 * TICK_NS, "1", "stalled", "its autopilot owes a packet")
    report.close()
    return path


def test_true_states_have_their_own_instants(tmp_path: Path) -> None:
    truth = TruthWriter(tmp_path, ("0",))
    truth.append(3 * TICK_NS, [truth_at("0", 3 * TICK_NS + 9_375_000)])
    truth.close()
    assert Run(tmp_path).truth[["sim_time_s", "tick_ns"]].to_numpy().tolist() == [[0.159375, 3 * TICK_NS]]


@pytest.mark.parametrize("is_finished", [True, False])
def test_frames_have_what_was_written(tmp_path: Path, is_finished: bool) -> None:
    run = load_run(write(tmp_path / "run", is_finished=is_finished))
    assert (run.nodes, run.scenario.name) == (("0", "1"), "separation")
    assert len(run.truth) == 80
    one = run.truth[run.truth.node == "1"]
    assert one.sim_time_s.tolist() == pytest.approx([0.05 * i for i in range(40)])
    assert one.position_north_m.tolist() == pytest.approx([0.05 * i + 1.0 for i in range(40)])
    assert run.packets.fate.tolist() == ["delivered"] * 40
    assert run.packets.seq.tolist() == list(range(40))
    assert run.links.to_dict("records") == [
        {"radio": "main", "tx": "0", "rx": "1", "sent": 40, "delivered": 40}
    ]
    assert run.link_series(1.0).sent.tolist() == [20, 20]
    assert run.inputs[["tick_ns", "node", "kind", "link"]].to_numpy().tolist() == [
        [TICK_NS, "1", "open", 3],
        [TICK_NS, "1", "frame", 3],
    ]
    assert run.inputs.name[1] == "HEARTBEAT"
    assert run.events.to_dict("records") == [
        {
            "sim_time_s": 0.25,
            "sim_time_ns": 5 * TICK_NS,
            "node": "1",
            "kind": "stalled",
            "text": "its autopilot owes a packet",
        }
    ]
    assert [packet.payload for packet in run.transmitted("0")] == [b"abc"] * 40
    assert b"".join(entry.payload for entry in run.mavlink("0", "from_autopilot")) == bytes(range(40))
    assert list(run.transmitted("1")) == []
    for nobodys in (lambda: run.transmitted("77"), lambda: run.mavlink("77", "to_autopilot")):
        with pytest.raises(ValueError, match="no node has the id '77'; there are 0, 1"):
            nobodys()


def test_arrays_and_arrow_are_the_same_from_journal_and_parquet(tmp_path: Path) -> None:
    done, killed = (
        load_run(write(tmp_path / name, is_finished=name == "done")) for name in ("done", "killed")
    )
    assert (killed.path / "truth.journal").exists()
    for table in ("truth", "deliveries"):
        a, b = done.table(table), killed.table(table)
        assert a.to_pydict() == b.to_pydict()
        assert a.column_names == b.column_names
        for name, values in done.columns(table).items():
            assert np.array_equal(values, killed.columns(table)[name])
    assert list(done.columns("truth", ["node", "tick_ns"])) == ["node", "tick_ns"]
    with pytest.raises(ValueError, match="no column speed; there are tick_ns, node"):
        done.columns("truth", ["speed"])
    with pytest.raises(ValueError, match="no table 'fates'; there are truth"):
        done.table("fates")


def test_a_killed_run_has_no_end(tmp_path: Path) -> None:
    run = load_run(write(tmp_path / "run", is_finished=False))
    assert (run.summary, run.ending, run.verdict, run.digest) == ({}, "", "", "")
    assert repr(run) == "<Run run: without an end>"


def test_what_is_no_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(NoRun, match=r"scenario.yaml"):
        load_run(tmp_path)
    write(tmp_path / "runs" / "mine")
    assert load_run("mine").path == tmp_path / "runs" / "mine"
    shutil.rmtree(tmp_path / "runs")
    with pytest.raises(NoRun, match=r"runs/mine"):
        load_run("mine")


def test_the_page_on_python_has_all_frames_and_tables() -> None:
    page = (Path(__file__).parents[4] / "docs" / "how-to" / "python.md").read_text(encoding="utf-8")
    members = {name: getattr(member, "func", member) for name, member in vars(Run).items() if name[0] != "_"}
    frames = [
        name
        for name, each in members.items()
        if getattr(each, "__annotations__", {}).get("return") == "pd.DataFrame"
    ]
    assert {"truth", "packets", "agent_values"} <= set(frames)
    assert [name for name in frames if not re.search(rf"`run\.{name}\b", page)] == []
    listed = page.partition("Tables are ")[2].partition(":\n")[0]
    assert set(re.findall("`([a-z]+)`", listed)) == {*(table.name for table in TABLES), "logged"}


def log(made: RunContent) -> None:
    made.streams[logged("0")] = [Entry(0, encode_logged(LoggedValue("plan", {"to_m": 2, "late": True})))]


def test_what_agents_logged_is_a_table_too(tmp_path: Path) -> None:
    done, killed = (
        Run(make_run(tmp_path / name, log, is_finished=name == "done")) for name in ("done", "killed")
    )
    assert [(run.path / "logged.parquet").exists() for run in (done, killed)] == [True, False]
    for run in (done, killed):
        (run.path / SCENARIO_FILE).write_text(read_scenario("separation").to_yaml(), encoding="utf-8")
        assert run.table("logged", ["node", "key", "kind", "value"]).to_pylist() == [
            {"node": "0", "key": "to_m", "kind": "number", "value": 2.0},
            {"node": "0", "key": "late", "kind": "bool", "value": 1.0},
        ]
        columns = run.columns("logged", ["key", "tick_ns", "kind"])
        assert {name: column.tolist() for name, column in columns.items()} == {
            "key": ["to_m", "late"],
            "tick_ns": [0, 0],
            "kind": ["number", "bool"],
        }
        with pytest.raises(TableError, match="logged has no column speed; there are tick_ns, node, name"):
            run.table("logged", ["speed"])
    assert done.table("logged").schema == killed.table("logged").schema
    assert load_run(write(tmp_path / "silent")).columns("logged")["node"].tolist() == []
    shutil.rmtree(done.path / "streams")
    assert done.columns("logged", ["key"])["key"].tolist() == ["to_m", "late"]
    (done.path / "logged.parquet").write_bytes(b"PAR1 no more")
    with pytest.raises(TableError, match=r"logged\.parquet: damaged"):
        done.table("logged")


def test_what_a_record_has_lost_is_not_taken_for_nothing(tmp_path: Path) -> None:
    folder = make_run(tmp_path / "run", log)
    (folder / SCENARIO_FILE).write_text(read_scenario("separation").to_yaml(), encoding="utf-8")
    (folder / "logs").mkdir()
    (folder / "summary.json").write_text(json.dumps({"digests": digests(folder)}))
    whole = load_run(folder)
    assert whole.agent_values("plan")[["to_m", "late"]].to_numpy().tolist() == [[2, True]]
    assert len(list(whole.mavlink("1", "from_autopilot"))) == 20
    shutil.rmtree(folder / "streams")
    lost = load_run(folder)
    place = re.escape(f"{folder}: the record has lost ")
    told = f"^{place}logged/0; logged.parquet has the numbers and texts$"
    for asked in (lambda: lost.agent_data, lambda: lost.agent_values("plan"), lambda: lost.activities):
        with pytest.raises(ValueError, match=told):
            asked()
    with pytest.raises(ValueError, match=f"^{place}packets/1$"):
        lost.transmitted("1")
    with pytest.raises(ValueError, match=f"^{place}mavlink/1/from_autopilot$"):
        lost.mavlink("1", "from_autopilot")
    (folder / "summary.json").unlink()
    with pytest.raises(ValueError, match=f"^{place}logged; logged.parquet has"):
        _ = load_run(folder).agent_data


def test_where_agents_logged_nothing_there_is_nothing(tmp_path: Path) -> None:
    run = load_run(write(tmp_path / "run"))
    assert len(run.agent_data) == 0
    assert list(run.transmitted("1")) == []


def test_an_error_in_what_another_version_has_made_says_so(tmp_path: Path) -> None:
    path = write(tmp_path / "run")
    write_provenance(Provenance(lostlink="0.0.9"), path)
    (path / "truth.parquet").write_bytes(b"damaged")
    run = load_run(path)
    with pytest.raises(TableError) as told:
        run.columns("truth")
    [note] = told.value.__notes__
    assert note.startswith(f"{path}: another version has made this record: lostlink 0.0.9; this is lostlink ")
    with pytest.raises(ValueError, match="no table 'nothing'") as told_of_callers:
        run.columns("nothing")
    assert not hasattr(told_of_callers.value, "__notes__")
    write_provenance(collect({}), path)
    with pytest.raises(TableError) as told:
        run.columns("truth")
    assert not hasattr(told.value, "__notes__")
