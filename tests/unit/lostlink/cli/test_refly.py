"""`lostlink refly` hands a recorded run to a flight, compares what comes back, and says what may be the reason."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from bridge.fleet.autopilots.dirs import AutopilotDirs
from bridge.record.events import Report
from bridge.record.inputs.file import InputWriter, PacketWay, RecordedInput
from bridge.record.names import inputs_path, packets, streams_of
from bridge.record.provenance import AutopilotOrigin, Provenance, collect, write_provenance
from bridge.record.streams import packed_path
from bridge.record.tables.truth import TRUTH
from bridge.run.directory import RunDirectory
from bridge.scenario.file import read_scenario, with_changes
from bridge.scenario.model import Scenario
from lostlink.cli.flying import refly as command
from tests.unit.bridge.record.runs import TICK_NS, Change, change_table, make_run


@dataclass
class FakeFlight:
    """Copies the run that it is to replay, and alters the copy."""

    alter: Callable[[Path], object] = lambda _: None
    summary: dict[str, Any] = field(default_factory=lambda: {"ending": "done"})
    seen: dict[str, Any] = field(default_factory=dict)

    def __call__(self, scenario: Scenario, directory: RunDirectory, **options: Any) -> dict[str, Any]:
        self.seen = {"scenario": scenario, "directory": directory, **options}
        shutil.copytree(options["replay"], directory.path, dirs_exist_ok=True)
        self.alter(directory.path)
        return self.summary


@pytest.fixture
def fly(monkeypatch: pytest.MonkeyPatch) -> FakeFlight:
    fake = FakeFlight()
    monkeypatch.setattr(command, "_flight", lambda: fake)
    monkeypatch.setattr(command, "preflight", lambda *_, **__: None)
    monkeypatch.setattr(command, "at_ports", lambda scenario, *_, **__: nullcontext(scenario))
    return fake


def recorded(
    tmp_path: Path, ending: str | None = "done", change: Change = lambda _: None, *, is_finished: bool = True
) -> Path:
    run = make_run(tmp_path / "recorded", change, is_finished=is_finished)
    RunDirectory(run).write(read_scenario("separation"), "tcp/127.0.0.1:1")
    (run / "run.json").write_text(
        json.dumps({"run": "recorded", "endpoint": "tcp/127.0.0.1:1", "pid": 2**22 + 1})
    )
    if ending is not None:
        (run / "summary.json").write_text(json.dumps({"ending": ending}))
    write_provenance(Provenance(lostlink="0.1.0"), run)
    return run


def refly(tmp_path: Path, run: Path, *options: str) -> Result:
    return CliRunner().invoke(command.refly, [str(run), "--out", str(tmp_path / "out"), *options])


def change_truth(run: Path) -> None:
    change_table(run, -1, wind_down_mps=1e-300)


def test_same_flight_is_identical(tmp_path: Path, fly: FakeFlight) -> None:
    run = recorded(tmp_path)
    done = refly(tmp_path, run)
    assert done.exit_code == 0, done.output
    assert done.stdout.splitlines()[1] == "identical: truth, deliveries, 6 streams; 168 entries, 20 ticks"
    assert done.stderr == ""
    assert (fly.seen["replay"], fly.seen["stop_ns"], fly.seen["quiet"]) == (run, None, False)
    assert fly.seen["directory"].path.parent == tmp_path / "out"
    assert fly.seen["scenario"].speed == "max"


@pytest.mark.parametrize("is_packed", [False, True])
def test_a_stream_that_was_cut_off_is_told_before_anything_flies(
    tmp_path: Path, fly: FakeFlight, is_packed: bool
) -> None:
    run = recorded(tmp_path, is_finished=is_packed)
    stream = streams_of(run)[0]
    file = packed_path(stream.path(run)) if is_packed else stream.path(run)
    file.write_bytes(file.read_bytes()[:-5])
    done = refly(tmp_path, run)
    assert done.exit_code == 2
    assert f"{stream.path(run)}: offset " in done.stderr
    assert "damaged: it is cut off" in done.stderr
    assert fly.seen == {}


def test_a_stream_of_a_run_that_was_killed_may_be_cut_off(tmp_path: Path, fly: FakeFlight) -> None:
    run = recorded(tmp_path, ending=None, is_finished=False)
    file = streams_of(run)[0].path(run)
    file.write_bytes(file.read_bytes()[:-5])
    refly(tmp_path, run)
    assert fly.seen["replay"] == run


def test_scenario_is_the_recorded_one_but_for_speed_and_ports(tmp_path: Path, fly: FakeFlight) -> None:
    run = recorded(tmp_path)
    refly(
        tmp_path,
        run,
        "--speed",
        "2",
        "--first-slot",
        "7",
        "--zenoh-port",
        "0",
        "--ardupilot-dir",
        str(tmp_path),
    )
    old, new = RunDirectory(run).scenario, fly.seen["scenario"]
    assert (new.speed, new.ports.first_slot, new.ports.zenoh) == (2.0, 7, 0)
    same = {"speed": old.speed, "ports": old.ports}
    assert new.model_copy(update=same) == old
    assert fly.seen["dirs"] == AutopilotDirs(ardupilot=tmp_path)


def test_each_autopilot_is_that_of_the_record_unless_said_otherwise(tmp_path: Path, fly: FakeFlight) -> None:
    run = recorded(tmp_path)
    flown = {
        "0": AutopilotOrigin("px4", path="/px4/build/bin/px4"),
        "1": AutopilotOrigin("ardupilot", path="/ardupilot/bin/arducopter"),
        "2": AutopilotOrigin("standin"),
    }
    write_provenance(Provenance(lostlink="0.1.0", autopilots=flown), run)
    refly(tmp_path, run)
    assert fly.seen["dirs"] == AutopilotDirs(Path("/ardupilot/bin"), Path("/px4/build"))
    refly(tmp_path, run, "--px4-dir", str(tmp_path))
    assert fly.seen["dirs"] == AutopilotDirs(Path("/ardupilot/bin"), tmp_path)


def test_altered_number_is_found(tmp_path: Path, fly: FakeFlight) -> None:
    fly.alter = change_truth
    done = refly(tmp_path, recorded(tmp_path), "--quiet")
    assert done.exit_code == 1
    assert done.stdout.startswith(
        "first difference at 0.95 s of sim time: node 1, truth, wind_down_mps in row 39\n"
    )


def test_json_has_comparison_and_summary(tmp_path: Path, fly: FakeFlight) -> None:
    fly.alter = change_truth
    run = recorded(tmp_path)
    done = refly(tmp_path, run, "--json")
    content = json.loads(done.stdout)
    assert fly.seen["quiet"] is True
    assert (content["identical"], content["difference"]["stream"]) == (False, "truth")
    assert (content["run"], content["summary"], content["compared_until_ns"]) == (
        str(run),
        {"ending": "done"},
        None,
    )
    assert content["reflown"] == str(fly.seen["directory"].path)


@pytest.mark.parametrize("ending", ["interrupted", "failed", None])
def test_interrupted_run_is_flown_and_compared_to_its_last_whole_tick(
    tmp_path: Path, fly: FakeFlight, ending: str | None
) -> None:
    fly.alter = change_truth  # in the last tick, which was not whole
    done = refly(tmp_path, recorded(tmp_path, ending))
    assert done.exit_code == 0, done.output
    assert fly.seen["stop_ns"] == 18 * TICK_NS
    assert done.stdout.splitlines()[-1].endswith("19 ticks up to its last whole tick, 0.90 s")


def test_killed_run_with_files_cut_off_is_compared_as_far_as_they_go(tmp_path: Path, fly: FakeFlight) -> None:
    run = recorded(tmp_path, None, is_finished=False)
    whole = TRUTH.journal_path(run).read_bytes()
    TRUTH.journal_path(run).write_bytes(whole[:5000])
    fly.alter = lambda path: TRUTH.journal_path(path).write_bytes(whole)
    assert refly(tmp_path, run).exit_code == 0


def test_other_provenance_is_told_as_a_possible_reason(tmp_path: Path, fly: FakeFlight) -> None:
    fly.alter = lambda path: write_provenance(Provenance(lostlink="0.2.0"), path)
    done = refly(tmp_path, recorded(tmp_path))
    assert done.stderr.splitlines() == [
        "lostlink: warning: lostlink 0.1.0 made the record, this is 0.2.0; a difference may come from there"
    ]
    fly.alter = lambda path: (path / "provenance.json").unlink()
    assert "does not say what it was made with" in refly(tmp_path, tmp_path / "recorded").stderr


def test_reasons_why_it_may_not_repeat_are_told(tmp_path: Path, fly: FakeFlight) -> None:
    run = recorded(tmp_path)
    report = Report(run, "physics")
    report.may_not_repeat("UA 1 was let go at 12.30 s")
    report.close()
    done = refly(tmp_path, run)
    assert "warning: this run may not repeat: UA 1 was let go at 12.30 s" in done.stderr


@pytest.mark.parametrize("has_packets", [True, False])
def test_packets_of_free_programs_are_told_to_be_taken_from_the_record(
    tmp_path: Path, fly: FakeFlight, has_packets: bool
) -> None:
    run = recorded(tmp_path)
    free = with_changes(read_scenario("separation"), {"nodes.1.agent": {"type": "free"}})
    RunDirectory(run).write(free, "")
    report = Report(run, "router")
    report.may_not_repeat(reason := "a program that the clock does not wait for transmits as node 1")
    report.close()
    if not has_packets:
        packed_path(packets("1").path(run)).unlink()
    told = [line for line in refly(tmp_path, run).stderr.splitlines() if "the new run" not in line]
    note = "lostlink: note: what a program transmitted as node 1 is taken from the record"
    warning = f"lostlink: warning: this run does not repeat: {reason}, and packets/1 is missing"
    assert [line for line in told if "node 1" in line] == [note if has_packets else warning]


def test_flight_that_broke_off_is_no_success(tmp_path: Path, fly: FakeFlight) -> None:
    fly.summary = {"ending": "failed", "error": "physics ended"}
    done = refly(tmp_path, recorded(tmp_path))
    assert done.exit_code == 1
    assert "the new run broke off: physics ended" in done.stderr
    assert done.stdout.splitlines()[-1] == (
        "the endings differ: the recorded run ended as 'done', the new one as 'failed'"
    )


@pytest.mark.parametrize(
    ("before", "now", "text"),
    [
        ("failed", "failed", ""),
        ("failed", "duration", ""),
        ("interrupted", "duration", ""),
        ("interrupted", "done", ""),
        (None, "duration", ""),
        ("duration", "duration", ""),
        ("done", "duration", "the recorded run ended as 'done', the new one as 'duration'"),
        ("interrupted", "failed", "the recorded run ended as 'interrupted', the new one as 'failed'"),
        (None, "failed", "the recorded run has no ending in its summary, the new one as 'failed'"),
    ],
)
def test_status_1_is_for_a_difference_or_another_ending_only(
    tmp_path: Path, fly: FakeFlight, before: str | None, now: str, text: str
) -> None:
    fly.summary = {"ending": now}
    done = refly(tmp_path, recorded(tmp_path, before), "--quiet")
    assert done.exit_code == bool(text), done.output
    assert done.stdout.startswith("identical")
    assert ("the endings differ: " in done.stdout) == bool(text)
    assert text in done.stdout
    content = json.loads(refly(tmp_path, tmp_path / "recorded", "--json").stdout)
    assert (content["identical"], bool(content["other_ending"])) == (True, bool(text))


def test_interrupted_flight_is_not_compared(tmp_path: Path, fly: FakeFlight) -> None:
    fly.summary = {"ending": "interrupted"}
    done = refly(tmp_path, recorded(tmp_path))
    assert done.exit_code == 130
    assert "identical" not in done.output


def wrong_input(run: Path) -> None:
    path = inputs_path(run, "0")
    writer = InputWriter(path)
    writer.write(RecordedInput.opened(0, 1))
    writer.close()
    path.write_text(path.read_text() + '{"tick_ns": 1}\n')


def packet_by(way: PacketWay) -> Callable[[Path], None]:
    """Have the record say that a packet entered node 0 from outside."""

    def write(run: Path) -> None:
        writer = InputWriter(inputs_path(run, "0"))
        writer.write(RecordedInput.packet(50, way, b"E"))
        writer.close()

    return write


def test_packets_that_can_go_where_they_say_are_no_hindrance(tmp_path: Path, fly: FakeFlight) -> None:
    run = recorded(tmp_path)
    packet_by(PacketWay(to="1"))(run)
    refly(tmp_path, run)
    assert fly.seen


@pytest.mark.parametrize(
    ("spoil", "text"),
    [
        (shutil.rmtree, "no such directory"),
        (
            packet_by(PacketWay(to="7")),
            "inputs/0.jsonl, at tick_ns 50: key 'to': '7'; on radio main there are 1, all",
        ),
        (packet_by(PacketWay(to="0")), "key 'to': '0'; on radio main there are 1, all"),
        (packet_by(PacketWay("mesh")), "inputs/0.jsonl, at tick_ns 50: key 'radio': 'mesh'; node 0 has main"),
        (lambda run: (run / "scenario.yaml").unlink(), "it has no scenario.yaml"),
        (lambda run: (run / "scenario.yaml").write_text("a: 1"), "scenario.yaml"),
        (wrong_input, "0.jsonl:2: key 'kind'"),
        (
            lambda run: [shutil.rmtree(run / "streams"), (run / "deliveries.parquet").unlink()],
            "nothing to compare with",
        ),
        (
            lambda run: [(run / "truth.parquet").unlink(), (run / "summary.json").unlink()],
            "before its first whole tick",
        ),
        (
            lambda run: (run / "deliveries.parquet").write_bytes(
                (run / "deliveries.parquet").read_bytes()[:-9]
            ),
            "deliveries.parquet",
        ),
    ],
)
def test_what_cannot_be_flown_again_has_status_2(
    tmp_path: Path, fly: FakeFlight, spoil: Callable[[Path], object], text: str
) -> None:
    run = recorded(tmp_path)
    spoil(run)
    done = refly(tmp_path, run)
    assert (done.exit_code, fly.seen) == (2, {})
    assert text in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_run_that_goes_on_cannot_be_flown_again(tmp_path: Path, fly: FakeFlight) -> None:
    run = recorded(tmp_path)
    with RunDirectory(run).going_on():
        done = refly(tmp_path, run)
    assert (done.exit_code, fly.seen) == (2, {})
    assert "has not ended yet" in done.stderr
    assert refly(tmp_path, run).exit_code == 0


def test_run_without_streams_is_compared_by_its_tables(tmp_path: Path, fly: FakeFlight) -> None:
    run = recorded(tmp_path)
    shutil.rmtree(run / "streams")
    done = refly(tmp_path, run)
    assert done.exit_code == 0
    assert "has no streams/: only its tables can be compared" in done.stderr
    assert done.stdout.splitlines()[-1] == "identical: truth, deliveries; 80 entries, 20 ticks"


AGENT = "from lostlink import Agent\nclass Mine(Agent): ...\n"


@pytest.fixture
def handed_in(tmp_path: Path) -> Path:
    """A folder with an agent and a run of it, which was flown where nothing is any more."""
    work = tmp_path / "work"
    work.mkdir()
    (work / "mine.py").write_text(AGENT)
    run = recorded(work)
    agents = {f"nodes.{node}.agent": {"type": "own", "class": f"{work}/mine.py:Mine"} for node in ("0", "1")}
    RunDirectory(run).write(with_changes(read_scenario("separation"), agents), "")
    write_provenance(replace(collect({}, [work / "mine.py"]), git_commit=""), run)
    (tmp_path / "unzipped").mkdir()
    return work.rename(tmp_path / "unzipped" / "ann")


def test_a_run_that_was_handed_in_with_its_agents_is_flown(
    tmp_path: Path, handed_in: Path, fly: FakeFlight
) -> None:
    done = refly(tmp_path, handed_in / "recorded")
    assert done.exit_code == 0, done.output
    assert {node.agent.place for node in fly.seen["scenario"].ua} == {f"{handed_in}/mine.py"}
    assert f"note: files that were in {tmp_path}/work are taken from {handed_in}\n" in done.stderr


def test_an_agent_that_cannot_be_found_is_told_by_key_with_what_to_do(
    tmp_path: Path, handed_in: Path, fly: FakeFlight
) -> None:
    run = shutil.move(handed_in / "recorded", tmp_path / "alone")
    done = refly(tmp_path, run)
    assert (done.exit_code, fly.seen) == (2, {})
    assert f"{run}/scenario.yaml:" in done.stderr
    assert f"nodes.0.agent.class: {tmp_path}/work/mine.py: no such file" in done.stderr
    assert "--code FOLDER" in done.stderr
    assert refly(tmp_path, run, "--code", str(handed_in)).exit_code == 0


def test_an_agent_of_other_content_is_flown_where_the_user_says_and_told(
    tmp_path: Path, handed_in: Path, fly: FakeFlight
) -> None:
    (handed_in / "mine.py").write_text(AGENT + "# other\n")
    assert refly(tmp_path, handed_in / "recorded").exit_code == 2
    fly.alter = lambda run: write_provenance(collect({}, [handed_in / "mine.py"]), run)
    done = refly(tmp_path, handed_in / "recorded", "--code", str(handed_in))
    assert f"warning: {handed_in}/mine.py is another than that of the record" in done.stderr
