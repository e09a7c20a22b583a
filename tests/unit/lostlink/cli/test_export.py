"""`lostlink export` writes the tables of a run for other programs, and makes up for an end that never came."""

from __future__ import annotations

import csv
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner, Result

from bridge.record import names
from bridge.record.digests import digests
from bridge.record.logged import LoggedValue, encode_logged
from bridge.record.streams import Entry
from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.truth import TRUTH
from bridge.run.directory import RunDirectory
from bridge.scenario.file import read_scenario
from lostlink.cli.records.export import export
from tests.unit.bridge.record.runs import RunContent, make_run
from tests.unit.lostlink.export.mcap.files import read_mcap


def run(*arguments: object) -> Result:
    return CliRunner().invoke(export, [str(a) for a in arguments])


@pytest.mark.parametrize("is_finished", [True, False])
def test_csv_of_a_run_that_ended_and_of_one_that_was_killed(tmp_path: Path, is_finished: bool) -> None:
    folder = make_run(
        tmp_path / "run", lambda run: run.change_row(3, per=1e-7, distance_m=0.0), is_finished=is_finished
    )
    done = run(folder, "--csv", "--out", tmp_path / "new" / "out")
    paths = [tmp_path / "new" / "out" / name for name in ("truth.csv", "deliveries.csv")]
    assert (done.exit_code, done.output.split()) == (0, [str(path) for path in paths])
    lines = paths[1].read_text().splitlines()
    assert lines[0] == (
        "sim_time_ns,tx,rx,seq,packets,length_bytes,distance_m,received_power_dbm,snr_db,per,fate,"
        "radio,channel,encoding,received_ns,entered_ns,started_ns,ended_ns,arrived_ns,attempts"
    )
    assert lines[1] == "0,0,1,0,1,40,100.000,-70.000,20.000,0.0100000,delivered,main,team,,50000000,0,0,0,0,1"
    at_once = "50000000,50000000,50000000,50000000,1"
    assert (
        lines[4]
        == f"50000000,1,0,1,1,40,0.000,-70.000,20.000,0.0000001,delivered,main,team,,100000000,{at_once}"
    )
    assert len(lines) == 41
    with paths[0].open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 40
    assert (rows[3]["tick_ns"], rows[3]["node"], rows[3]["position_north_m"]) == ("50000000", "1", "1.05")
    assert float(rows[7]["position_north_m"]) == 0.15 + 1.0


def test_texts_of_a_csv_may_have_any_character_that_ends_lines(tmp_path: Path) -> None:
    texts = ["cr\rlf", "lf\ncr", "\r", "\r\n", "\n\r", "plain"]

    def log(made: RunContent) -> None:
        entries = [
            Entry(50_000_000 * k, encode_logged(LoggedValue("said", text))) for k, text in enumerate(texts)
        ]
        made.streams[names.logged("0")] = entries

    folder = make_run(tmp_path / "run", log)
    assert run(folder, "--csv").exit_code == 0
    with (folder / "logged.csv").open(newline="", encoding="utf-8") as file:
        assert [row["text"] for row in csv.DictReader(file)] == texts
    assert (folder / "logged.csv").read_bytes().endswith(b",plain\n")


def test_csv_goes_into_the_run_itself(tmp_path: Path) -> None:
    folder = make_run(tmp_path / "run")
    assert run(folder, "--csv").exit_code == 0
    assert {path.name for path in folder.glob("*.csv")} == {"truth.csv", "deliveries.csv"}


@pytest.mark.parametrize("content", ["[]", "{", "[" * 100_000])
def test_a_summary_that_is_none_is_told(tmp_path: Path, content: str) -> None:
    folder = make_run(tmp_path / "run")
    (folder / "scenario.yaml").write_text(read_scenario("separation").to_yaml(), encoding="utf-8")
    (folder / "summary.json").write_text(content)
    done = run(folder, "--mcap")
    assert done.exit_code == 2
    assert "summary.json: not a summary: " in done.stderr


def test_parquet_of_a_killed_run_is_that_of_its_end(tmp_path: Path) -> None:
    ended, killed = make_run(tmp_path / "ended"), make_run(tmp_path / "killed", is_finished=False)
    assert not {"truth", "deliveries"} & digests(killed).keys()
    done = run(killed, "--parquet")
    assert done.exit_code == 0
    made = [Path(line).name for line in done.output.splitlines()]
    assert {"truth.parquet", "deliveries.parquet"} <= set(made)
    assert len(made) == len(set(made)) == len(list(killed.glob("*.parquet")))
    assert digests(killed) == digests(ended)
    assert not TRUTH.journal_path(killed).exists()
    assert pq.read_table(DELIVERIES.parquet_path(killed)).num_rows == 40
    done = run(ended, "--parquet")
    assert (done.exit_code, done.output) == (0, f"{ended}: its tables are Parquet already\n")


def test_a_run_that_goes_on_keeps_its_journal(tmp_path: Path) -> None:
    folder = make_run(tmp_path / "run", is_finished=False)
    with RunDirectory(folder).going_on():
        done = run(folder, "--parquet")
    assert (done.exit_code, "has not ended yet" in done.output) == (2, True)
    assert TRUTH.journal_path(folder).exists()
    assert run(folder, "--csv").exit_code == 0


def test_what_cannot_be_exported_has_status_2(tmp_path: Path) -> None:
    folder = make_run(tmp_path / "run")
    TRUTH.parquet_path(folder).write_bytes(b"PAR1")
    (tmp_path / "empty").mkdir()
    for arguments, text in (
        ((folder, "--csv"), "truth.parquet: damaged"),
        ((tmp_path / "empty", "--csv"), "neither truth, nor states, nor measurements, nor deliveries"),
        ((folder,), "one of --csv, --parquet and --mcap is needed"),
        ((folder, "--csv", "--payloads"), "go with --mcap"),
        ((folder, "--mcap"), "scenario.yaml"),
        ((tmp_path / "none", "--csv"), "does not exist"),
    ):
        done = run(*arguments)
        assert (done.exit_code, text in done.output) == (2, True), done.output
    assert not list(folder.glob("*.csv"))


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (("--rate", "truths=5"), "no kind of topic 'truths'; there are clock, truth, pose"),
        (("--rate", "truth=fast"), "'fast' is no number"),
        (
            ("--rate", "truth=-1"),
            "options: rates_hz.truth: has to be greater than or equal to 0 (got -1.0)\n",
        ),
        (("--rate", "truth=nan"), "Error: options: rates_hz.truth: has to be a finite number (got nan)"),
        (("--size", "packets=0"), "greater than or equal to 1"),
        (("--mavlink", "some"), "'frames', 'messages', 'none'"),
    ],
)
def test_mistakes_about_mcap_have_status_2(tmp_path: Path, options: tuple[str, ...], text: str) -> None:
    folder = make_run(tmp_path / "run")
    (folder / "scenario.yaml").write_text(read_scenario("separation").to_yaml(), encoding="utf-8")
    done = run(folder, "--mcap", *options)
    assert (done.exit_code, text in done.output) == (2, True), done.output
    assert "https://" not in done.output
    assert not (folder / "run.mcap").exists()


def test_a_run_is_written_as_mcap_by_its_tables_alone(tmp_path: Path) -> None:
    folder = make_run(tmp_path / "run")
    (folder / "scenario.yaml").write_text(read_scenario("separation").to_yaml(), encoding="utf-8")
    done = run(folder, "--mcap", "--out", tmp_path / "out")
    assert (done.exit_code, done.output) == (0, f"{tmp_path / 'out' / 'run.mcap'}\n")
    read = read_mcap(tmp_path / "out" / "run.mcap")
    assert read.counts == read.statistics
    assert {"/clock", "/ua_0/truth", "/fates"} <= read.counts.keys()


def test_a_record_that_has_lost_its_streams_replaces_no_mcap_and_says_what_one_lacks(tmp_path: Path) -> None:
    folder = make_run(tmp_path / "run")
    (folder / "scenario.yaml").write_text(read_scenario("separation").to_yaml(), encoding="utf-8")
    (folder / "logs").mkdir()
    (folder / "summary.json").write_text(json.dumps({"digests": digests(folder)}))
    whole = folder / "run.mcap"
    assert [run(folder, "--mcap").stderr for _ in range(2)] == ["", ""]
    content = whole.read_bytes()
    shutil.rmtree(folder / "streams")
    lost = (
        "mavlink/0/from_autopilot, mavlink/0/to_autopilot, mavlink/1/from_autopilot, mavlink/1/to_autopilot, "
    )
    lost += "packets/0, packets/1"
    done = run(folder, "--mcap")
    assert (done.exit_code, done.stdout) == (2, "")
    assert done.stderr == (
        f"lostlink: {whole} is there, and may have what the record has lost: {lost}; "
        "it is not replaced: name another folder with --out\n"
    )
    assert whole.read_bytes() == content
    (folder / "logs").rmdir()
    done, other = run(folder, "--mcap", "--out", tmp_path / "out"), tmp_path / "out" / "run.mcap"
    assert (done.exit_code, done.stdout) == (0, f"{other}\n")
    assert done.stderr == f"lostlink: warning: {other} lacks what the record has lost: {lost} and 1 more\n"
    assert not [topic for topic in read_mcap(other).counts if topic.endswith("packets")]


def test_a_record_that_has_lost_tables_says_what_there_is_no_csv_of(tmp_path: Path) -> None:
    def log(made: RunContent) -> None:
        made.streams[names.logged("0")] = [Entry(0, encode_logged(LoggedValue("said", "text")))]

    folder = make_run(tmp_path / "run", log)
    summary = folder / "summary.json"
    summary.write_text(json.dumps({"digests": digests(folder)}))
    assert run(folder, "--csv").stderr == ""
    DELIVERIES.parquet_path(folder).unlink()
    shutil.rmtree(folder / "streams")
    done = run(folder, "--csv", "--out", tmp_path / "out")
    assert (done.exit_code, {path.name for path in (tmp_path / "out").iterdir()}) == (0, {"truth.csv"})
    lost = f"lostlink: warning: {folder}: the record has lost deliveries, logged/0: not in these files\n"
    assert done.stderr == lost
    summary.write_text("{")
    assert run(folder, "--csv").exit_code == 0


SMALL_FILES = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))
from lostlink.cli.main import main
sys.argv = ["lostlink", "export", *sys.argv[1:]]
main()
"""


@pytest.mark.slow
@pytest.mark.parametrize("option", ["--mcap", "--csv"])
def test_of_a_file_that_could_not_be_written_nothing_is_left(tmp_path: Path, option: str) -> None:
    folder = make_run(tmp_path / "run")
    (folder / "scenario.yaml").write_text(read_scenario("separation").to_yaml(), encoding="utf-8")
    there = set(folder.iterdir())
    done = subprocess.run(
        [sys.executable, "-B", "-c", SMALL_FILES, folder, option], capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"lostlink: {folder}: [Errno 27] File too large\n"
    assert set(folder.iterdir()) == there
