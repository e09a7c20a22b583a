"""A summary that was written by hand is not taken for that of its record."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from bridge.radio.ledger_file import LEDGER
from bridge.run.directory import SUMMARY_FILE, RunDirectory
from lostlink.cli.records.compare import compare
from lostlink.cli.records.report import report
from lostlink.compare.summary import mistakes_in_summary
from lostlink.flight.summary import NOT_COUNTED, Timing, summarise, write_summary
from tests.unit.lostlink.replay.flown import TICK_NS, Sent, flown, scenario_of

TICKS = 20
NETWORKS = "networks: {mesh: {preset: telemetry-915, mtu_bytes: 200, medium: {model: airtime, queue: {packets: 2}}}}\n"


def send(tick: int) -> list[Sent]:
    """Of two networks: packets that get lost before the radio, wait, and are too long, for all and for one."""
    lost = 2 if tick == 5 else 0
    long = [Sent("1", length=900, radio="mesh"), Sent("0", "1", length=900, radio="mesh")]
    return [Sent("0", lost=lost), Sent("gcs", "0"), *[Sent("1", length=150, radio="mesh")] * 4, *long]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Path], Path]:
    """Gives a copy of a run with a summary."""
    radio = "{preset: corrected, medium: {model: ideal}}"
    scenario = scenario_of(radio, ("0", "1", "gcs"), extra=NETWORKS)
    run = flown(tmp_path_factory.mktemp("made") / "run", scenario, TICKS, send)
    timing = Timing(TICKS * TICK_NS / 1e9, 1.0)
    write_summary(summarise(scenario, RunDirectory(run), timing, "duration"), RunDirectory(run))

    def copied(to: Path) -> Path:
        shutil.copytree(run, to)
        return to

    return copied


@pytest.mark.parametrize("why", [NOT_COUNTED, "as another version says it"])
def test_a_summary_that_tells_of_a_network_by_which_nothing_went_is_that_of_its_record(
    why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its base loss was not looked at: so says the summary alone."""
    monkeypatch.setattr("lostlink.flight.summary.NOT_COUNTED", why)
    scenario = scenario_of("corrected", ("0", "1"), extra="networks: {video: wifi-5.8}\n")
    run = RunDirectory(flown(tmp_path / "run", scenario, TICKS))
    write_summary(summarise(scenario, run, Timing(TICKS * TICK_NS / 1e9, 1.0), "duration"), run)
    assert "video: base loss" in [each["name"] for each in run.summary["unjudged"]]
    assert mistakes_in_summary(run.path) == []
    change(run.path, lambda summary: summary["unjudged"].append({"name": "losses", "why": "too few"}))
    assert mistakes_in_summary(run.path) == ["unjudged: not those of ledger.json"]


def change(run: Path, alter: Callable[[dict[str, Any]], object]) -> None:
    file = run / SUMMARY_FILE
    content = json.loads(file.read_text())
    alter(content)
    file.write_text(json.dumps(content))


def forge(summary: dict[str, Any]) -> None:
    summary["links"][0]["delivered"] -= 1
    summary["digest"] = "0123456789abcdef" * 4


def invoke(command: Any, *arguments: object) -> Result:
    return CliRunner().invoke(command, [str(each) for each in arguments])


def test_a_summary_as_the_run_wrote_it_is_right(recorded: Callable[[Path], Path], tmp_path: Path) -> None:
    run = recorded(tmp_path / "a")
    summary = RunDirectory(run).summary
    causes = {cause for link in summary["links"] for cause in link["lost"]}
    assert {"transport", "too_long", "queue_full"} <= causes
    assert mistakes_in_summary(run) == []


@pytest.mark.parametrize(
    ("alter", "told"),
    [
        (lambda s: s["links"][0].update(delivered=7), "links, 0 to 1: delivered is "),
        (lambda s: s["links"].pop(0), "links, 0 to 1: sent is "),
        (lambda s: s.update(digest="0" * 64), "digest is 000000000000, that of the record "),
        (lambda s: s["digests"].update(truth="1" * 64), "digests.truth is 111111111111, that of the record "),
        (lambda s: s["digests"].pop("truth"), "digests.truth is nothing, that of the record "),
        (lambda s: s["bins"][0].update(delivered=1000), "bins: not those of ledger.json"),
    ],
)
def test_each_number_that_was_changed_is_told(
    recorded: Callable[[Path], Path], tmp_path: Path, alter: Callable[[dict[str, Any]], object], told: str
) -> None:
    run = recorded(tmp_path / "a")
    change(run, alter)
    assert any(line.startswith(told) for line in mistakes_in_summary(run))


def test_a_table_that_was_changed_is_told(recorded: Callable[[Path], Path], tmp_path: Path) -> None:
    run = recorded(tmp_path / "a")
    with (run / "truth.parquet").open("ab") as file:
        file.write(b"\0")
    assert mistakes_in_summary(run)[0].startswith("digests.truth is ")


@pytest.mark.parametrize("name", ["truth", "deliveries"])
def test_a_table_that_is_gone_is_told(recorded: Callable[[Path], Path], tmp_path: Path, name: str) -> None:
    run = recorded(tmp_path / "a")
    (run / f"{name}.parquet").unlink()
    assert re.fullmatch(rf"digests\.{name} is \w+, that of the record nothing", mistakes_in_summary(run)[0])


@pytest.mark.parametrize("text", ["[]", "{", "3", "null", "\u00ff"])
def test_a_damaged_ledger_is_told_by_its_name(
    recorded: Callable[[Path], Path], tmp_path: Path, text: str
) -> None:
    run = recorded(tmp_path / "a")
    (run / LEDGER).write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=f"^{run / LEDGER}: damaged: "):
        mistakes_in_summary(run)
    assert f"lostlink: {run / LEDGER}: damaged: " in invoke(report, run).stderr


def test_a_run_without_an_end_has_no_summary_to_be_wrong(
    recorded: Callable[[Path], Path], tmp_path: Path
) -> None:
    run = recorded(tmp_path / "a")
    (run / SUMMARY_FILE).unlink()
    assert mistakes_in_summary(run) == []


@pytest.mark.slow
def test_compare_and_report_say_so_with_status_1(recorded: Callable[[Path], Path], tmp_path: Path) -> None:
    a, b, c = (recorded(tmp_path / name) for name in "abc")
    assert invoke(compare, a, b).exit_code == 0
    change(b, forge)
    told = (
        f"lostlink: {b}: summary.json is not that of its record: digest is 0123456789ab, that of the record "
    )
    done = invoke(compare, a, b)
    assert done.exit_code == 1
    assert done.stdout.startswith("identical: ")
    assert told in done.stderr
    assert json.loads(invoke(compare, a, b, "--json").stdout)["summary_mistakes"].keys() == {str(b)}
    table = invoke(compare, a, b, c)
    assert table.exit_code == 1
    assert "The summary of b is not that of its record. All digests are equal" in table.stdout
    for run, status in ((a, 0), (b, 1)):
        done = invoke(report, run)
        assert done.exit_code == status
        assert (told in done.stderr) is bool(status)
        assert ("not that of the record" in (run / "report.html").read_text()) is bool(status)


def test_what_is_no_more_there_is_no_mistake(recorded: Callable[[Path], Path], tmp_path: Path) -> None:
    """A record may lose its streams, to be small; what is left is held against the summary."""
    run = recorded(tmp_path / "A")
    shutil.rmtree(run / "streams")
    assert mistakes_in_summary(run) == []
    change(run, lambda summary: summary["digests"].update(dict.fromkeys(summary["digests"], "0" * 64)))
    assert len(mistakes_in_summary(run)) > 1
