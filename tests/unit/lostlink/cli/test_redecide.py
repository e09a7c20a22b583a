"""`lostlink redecide`: what it prints, what it writes, what it ends with."""

from __future__ import annotations

import errno
import json
import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from click.testing import CliRunner, Result

from bridge.record.digests import file_digest
from bridge.record.provenance import collect, read_provenance, write_provenance
from bridge.record.tables.every import finish_tables
from bridge.record.tables.measurements import MeasurementWriter
from bridge.scenario.file import read_scenario
from bridge.scenario.resolve.named_files import named_code
from channel.presets import load_radio
from channel.sensing.measured import MEASURED, Measured
from lostlink.cli import now_and_then
from lostlink.cli.main import lostlink
from lostlink.compare.compare import compare
from lostlink.reading.run import load_run
from lostlink.reading.sent import SentPackets
from tests.unit.lostlink.replay.flown import flown, scenario_of

NODES = ("0", "1", "gcs")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flown(tmp_path_factory.mktemp("runs") / "made", scenario_of("moon2020", NODES), 50)


def redecide(*arguments: object) -> Result:
    return CliRunner().invoke(lostlink, ["redecide", *map(str, arguments)])


def test_the_same_radio_and_seed_are_said_to_be_the_same(run: Path) -> None:
    result = redecide(run)
    assert result.exit_code == 0
    assert "all 300 fates are the same, with their powers and error rates" in result.stdout
    assert "0 -> 1" in result.stdout
    assert result.stdout.splitlines()[-1].startswith(("pass: ", "no verdict: "))


def test_the_page_says_how_python_sees_it(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = (Path(__file__).parents[4] / "docs" / "how-to" / "replay.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```python\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    exec(
        re.sub(r"^(result\..*?)  #", r"print(\1)  #", block.replace("runs/A", str(run)), flags=re.MULTILINE),
        {},
    )
    shown = capsys.readouterr().out
    assert "received_power_dbm: double" in shown
    assert "LinkChange(radio='main', tx='0', rx='1'" in shown
    assert "Check(name='certain fates'" in shown


def test_of_a_directory_that_cannot_be_written_whole_nothing_stays(tmp_path: Path) -> None:
    made, out = flown(tmp_path / "made", scenario_of("moon2020", NODES), 5), tmp_path / "out"
    (made / "logs").mkdir(exist_ok=True)
    (made / "logs" / "node-0.log").symlink_to("nothing")
    result = redecide(made, "--out", out)
    assert (result.exit_code, result.stdout) == (2, "")
    last = result.stderr.splitlines()[-1]
    assert last.startswith(f"lostlink: {made / 'logs' / 'node-0.log'}: [Errno 2] No such file or directory")
    assert not out.exists()
    (made / "logs" / "node-0.log").unlink()
    assert redecide(made, "--out", out, "--quiet").exit_code == 0


def test_a_summary_that_is_none_is_told_before_anything_is_written(tmp_path: Path) -> None:
    made = flown(tmp_path / "made", scenario_of("moon2020", NODES), 5)
    (made / "summary.json").write_text("[]")
    result = redecide(made, "--out", tmp_path / "out")
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr.splitlines()[-1].endswith("summary.json: not a summary: a JSON object is expected")
    assert not (tmp_path / "out").exists()


def test_a_directory_that_is_not_empty_is_told_before_anything_is_decided(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    decided: list[object] = []
    monkeypatch.setattr("lostlink.redecision.redecide.decide", lambda *given: decided.append(given))
    (tmp_path / "mine.txt").touch()
    result = redecide(run, "--out", tmp_path)
    assert (result.exit_code, decided) == (2, [])
    assert result.stderr.splitlines()[-1].endswith("it is there already, and not empty")


def test_it_is_silent_for_less_than_two_seconds_also_while_it_reads(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second has passed before the command's own clock: of Python, and of what the command line imports."""
    now_s, said_s = [1.0], []

    def reads_slowly(*given: Any) -> SentPackets:
        now_s[0] += 0.6
        return SentPackets(*given)

    monkeypatch.setattr("bridge.run.every.monotonic", lambda: now_s[0])
    monkeypatch.setattr("lostlink.redecision.redecide.SentPackets", reads_slowly)
    monkeypatch.setattr(
        now_and_then, "say", lambda text, err=False: said_s.append((now_s[0], text)) if err else None
    )
    assert redecide(run).exit_code == 0
    assert said_s == [(pytest.approx(2.2), "decided 0 % of the packets")]


def test_fates_that_are_not_what_was_recorded_are_an_error(run: Path, tmp_path: Path) -> None:
    """As if the record were of a lostlink whose channel was another."""
    other = flown(tmp_path / "other", scenario_of("corrected", NODES), 50)
    (other / "scenario.yaml").write_text((run / "scenario.yaml").read_text())
    result = redecide(other, "--quiet")
    assert result.exit_code == 1
    assert "fates are other" in result.stdout


def test_another_rate_of_ticks_is_refused(run: Path) -> None:
    """Packets of two ticks would meet on the air, and positions between them be missing."""
    result = redecide(run, "--set", "tick_rate_hz=10")
    assert (result.exit_code, result.stdout) == (2, "")
    assert (
        result.stderr
        == f"lostlink: tick_rate_hz: {run} has 20 ticks a second; its packets cannot be decided at another rate\n"
    )


@pytest.mark.parametrize("is_cut", [False, True])
def test_powers_that_are_not_what_was_recorded_are_an_error_though_fates_are_the_same(
    tmp_path: Path, is_cut: bool
) -> None:
    """A link of a metre delivers all: a decibel less changes its powers, and no fate."""
    made = flown(tmp_path / "made", scenario_of("perfect", NODES), 10, killed=is_cut)
    if is_cut:
        deliveries = made / "deliveries.journal"
        deliveries.write_bytes(deliveries.read_bytes()[:-1000])
    scenario = made / "scenario.yaml"
    told = yaml.safe_load(scenario.read_text())
    told["radio"] = {
        "preset": "perfect",
        "transmit_power_dbm": load_radio("perfect").transmit_power_dbm - 1.0,
    }
    scenario.write_text(yaml.safe_dump(told))
    result = redecide(made, "--json")
    found = json.loads(result.stdout)
    assert (found["changed"], found["not_compared"] > 0, found["differs"]) == (0, is_cut, True)
    assert result.exit_code == 1


def test_of_a_killed_run_on_a_slow_medium_what_is_missing_is_no_error(tmp_path: Path) -> None:
    made = flown(tmp_path / "made", scenario_of("telemetry-915", NODES), 40, killed=True)
    stream = min((made / "streams" / "packets").iterdir())
    stream.write_bytes(stream.read_bytes()[:-400])
    result = redecide(made, "--json")
    found = json.loads(result.stdout)
    assert (found["differs"], found["changed"], found["not_compared"] > 0) == (True, 0, True)
    assert result.exit_code == 0


def test_a_packet_that_is_missing_of_a_whole_run_is_an_error(tmp_path: Path) -> None:
    made = flown(tmp_path / "made", scenario_of("perfect", NODES), 10)
    table = pq.read_table(made / "deliveries.parquet")
    pq.write_table(table.slice(1), made / "deliveries.parquet")
    result = redecide(made, "--json")
    found = json.loads(result.stdout)
    assert (found["differs"], found["not_compared"], found["is_same"]) == (False, 1, False)
    assert result.exit_code == 1


def test_another_radio_is_no_error_and_json_tells_all(run: Path) -> None:
    result = redecide(run, "--radio", "perfect", "--seed", 9, "--json")
    assert result.exit_code == 0
    told = json.loads(result.stdout)
    assert (told["radio"], told["seed"], told["fates"]) == ("perfect", 9, 300)
    assert sum(link["delivered_after"] for link in told["links"]) == 300
    assert sum(link["delivered_before"] for link in told["links"]) == 300 - told["changed"]
    assert [c["after"] for c in told["changes"]] == ["delivered"]
    assert told["verdict"].startswith("pass: ")


def test_a_value_of_the_radio_can_be_set(run: Path) -> None:
    told = json.loads(redecide(run, "--set", "radio.max_range_m=1", "--json").stdout)
    assert sum(link["lost_after"].get("out_of_range", 0) for link in told["links"]) == 300
    assert told["radio"] == {"preset": "moon2020", "max_range_m": 1}


def test_a_radio_file_is_as_seen_from_here(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine.yaml").write_text("preset: perfect\nmax_range_m: 1\n")
    monkeypatch.chdir(tmp_path)
    told = json.loads(redecide(run, "--radio", "mine.yaml", "--json").stdout)
    assert told["radio"] == str(tmp_path / "mine.yaml")
    assert told["changed"] > 0


def test_what_is_written_is_a_run(run: Path, tmp_path: Path) -> None:
    assert redecide(run, "--out", tmp_path / "same", "--quiet").exit_code == 0
    assert compare(run, tmp_path / "same") is None
    told = json.loads(redecide(run, "--radio", "disk", "--out", tmp_path / "disk", "--json").stdout)
    summary = json.loads((tmp_path / "disk" / "summary.json").read_text())
    assert told["digest"] == summary["digest"]
    assert summary["redecided_from"] == str(run)
    assert summary["radio"] == "disk"
    assert read_scenario(str(tmp_path / "disk" / "scenario.yaml")).radio == "disk"
    found = compare(run, tmp_path / "disk")
    assert found is not None
    assert found.stream == "deliveries"
    again = json.loads(redecide(tmp_path / "disk", "--json").stdout)
    assert again["is_same"]
    assert (tmp_path / "disk" / "probability_of_delivery.png").stat().st_size > 1000


def test_a_full_disk_leaves_the_directory_as_it_was(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("lostlink.redecision.whole_run.write_summary", full)
    (tmp_path / "there").mkdir(0o700)
    (tmp_path / "link").symlink_to("there")
    for name in ("there", "link", "new"):
        result = redecide(run, "--out", tmp_path / name)
        assert result.exit_code != 0
        assert "No space left on device" in result.stderr
    assert sorted(each.name for each in tmp_path.iterdir()) == ["link", "there"]
    assert list((tmp_path / "there").iterdir()) == []
    assert (tmp_path / "there").stat().st_mode & 0o777 == 0o700


EXPECTATIONS = """expectations:
  - {type: delivery, from: "0", to: "1", at_least: 0.9}
  - {type: delivery, from: "0", to: "1", at_least: 0.0, name: any}
"""


def test_expectations_are_judged_of_what_is_written(tmp_path: Path) -> None:
    """The verdict, the outcome and the status are those of its summary; without a directory nobody judges them."""
    made = flown(tmp_path / "made", scenario_of("perfect", NODES, extra=EXPECTATIONS), 20)
    lossy = ("--set", "radio.base_loss=0.999999", "--quiet")
    alone = redecide(made, *lossy)
    assert alone.exit_code == 0
    assert alone.stdout.splitlines()[-1].endswith("; 2 expectations are judged with --out")
    told = redecide(made, *lossy, "--out", tmp_path / "lossy")
    summary = json.loads((tmp_path / "lossy" / "summary.json").read_text())
    assert summary["outcome"] == "fail"
    assert told.exit_code == 3
    assert told.stdout.splitlines()[-1] == summary["verdict"]
    assert summary["verdict"].startswith("fail: 1 of 2 expectations not met: ")
    printed = json.loads(redecide(made, *lossy[:2], "--out", tmp_path / "again", "--json").stdout)
    assert (printed["outcome"], printed["verdict"]) == ("fail", summary["verdict"])
    assert redecide(made, "--out", tmp_path / "same", "--quiet").exit_code == 0


LAW = """from channel.variant import Variant
class Flat(Variant):
    def path_loss_db(self, path):
        return 0.0 * path.distance_m + {loss_db}
"""


@pytest.mark.slow
def test_an_edited_model_is_told_and_in_the_provenance_of_what_it_decides(tmp_path: Path) -> None:
    law = tmp_path / "laws.py"
    law.write_text(LAW.format(loss_db=80.0))
    radio = f"{{preset: hata-qpsk, propagation: {{class: '{law}:Flat'}}}}"
    scenario = scenario_of(radio, NODES)
    made = flown(tmp_path / "made", scenario, 20)
    write_provenance(collect({}, named_code(scenario).files), made)
    same = redecide(made, "--json")
    assert (same.exit_code, same.stderr) == (0, "")
    law.write_text(LAW.format(loss_db=150.0))
    told = redecide(made, "--json", "--out", tmp_path / "edited")
    assert told.exit_code == 1
    line = f"{law} is another than that of the record"
    assert told.stderr == f"lostlink: {line}\n"
    assert json.loads(told.stdout)["edited"] == [line]
    decided = read_provenance(tmp_path / "edited")
    assert decided is not None
    assert decided.files == {str(law): file_digest(law)}
    assert redecide(tmp_path / "edited", "--json").stderr == ""
    page = CliRunner().invoke(lostlink, ["report", str(made)])
    assert page.stderr.startswith(f"lostlink: {line}: the model's curve is that of today's\n")


def test_presets_of_another_lostlink_than_made_the_record_are_told(tmp_path: Path) -> None:
    """A record has copies of radios in files, and of what ships the names."""
    made = flown(tmp_path / "made", scenario_of("moon2020", NODES), 20)
    here = collect({})
    write_provenance(here, made)
    assert redecide(made, "--json").stderr == ""
    write_provenance(replace(here, git_commit="c" * 40), made)
    told = redecide(made, "--json", "--seed", 7)
    line = f"moon2020: preset as of {here.made_by}; lostlink {here.lostlink} at commit {'c' * 40} made the record"
    assert told.stderr == f"lostlink: {line}\n"
    assert json.loads(told.stdout)["edited"] == [line]
    assert redecide(made, "--json", "--radio", "wifi-2.4").stderr == ""  # asked for, as it is
    louder = redecide(made, "--json", "--set", "radio.transmit_power_dbm=17")
    assert louder.stderr == f"lostlink: {line}\n"


def test_a_run_decided_anew_has_lost_nothing_of_the_run(tmp_path: Path) -> None:
    made = flown(tmp_path / "made", scenario_of("moon2020", NODES), 20)
    (made / "logs").mkdir()
    (made / "logs" / "node-0.log").write_text(
        "2026-11-21 12:00:00.000 0.50s INFO agent: up\n", encoding="utf-8"
    )
    assert redecide(made, "--out", tmp_path / "disk", "--radio", "disk", "--quiet").exit_code == 0
    exported = CliRunner().invoke(lostlink, ["export", str(tmp_path / "disk"), "--mcap"])
    assert (exported.exit_code, exported.stderr) == (0, "")


@pytest.mark.parametrize("killed", [False, True])
def test_a_run_decided_anew_has_all_tables_of_the_run(tmp_path: Path, killed: bool) -> None:
    made = flown(tmp_path / "made", scenario_of("moon2020", NODES), 20, killed=killed)
    measured = MeasurementWriter(made, ["0"], ["e"])
    measured.write(0, measurement())
    measured.close()
    if not killed:
        finish_tables(made)
    assert redecide(made, "--out", tmp_path / "same", "--quiet").exit_code == 0
    assert compare(made, tmp_path / "same") is None
    again = load_run(tmp_path / "same")
    assert len(again.states) == 10 * len(NODES)
    assert again.measurements["power_dbm"].tolist() == [-60.0]
    assert not list((tmp_path / "same").rglob("*.journal"))


def measurement() -> Measured:
    one, number = np.zeros(1, dtype=np.intp), np.array([-60.0])
    return Measured(one, one, one, *[number] * 6, np.array([MEASURED], dtype=np.uint8))


def test_mistakes_are_told_in_a_line(run: Path, tmp_path: Path) -> None:
    for arguments, text in (
        ([tmp_path / "none"], "scenario.yaml"),
        ([run, "--radio", "nothere"], "no radio preset"),
        ([run, "--set", "radio.nonsense=1"], "nonsense: unknown key"),
        ([run, "--set", "radio"], "KEY=VALUE"),
        ([run, "--out", run], "not empty"),
    ):
        result = redecide(*arguments)
        assert result.exit_code == 2, arguments
        assert text in result.stderr
        assert len(result.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("radio.propagation.exponnet=3", "radio.propagation.exponnet: unknown key"),
        ("radio.base_loss=2", "radio.base_loss: has to be less than or equal to 1"),
    ],
)
def test_a_mistake_in_the_radio_has_its_key_in_the_scenario(run: Path, setting: str, told: str) -> None:
    result = redecide(run, "--set", setting)
    assert (result.exit_code, result.output.startswith(f"lostlink: {told}")) == (2, True), result.output
