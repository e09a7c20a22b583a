"""The summary's verdict judges what it says it judges."""

from __future__ import annotations

import io
import json
import tracemalloc
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from bridge.radio.ledger_file import LEDGER
from bridge.record.tables import reader
from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.truth import TRUTH
from bridge.run.directory import RunDirectory
from bridge.scenario.file import read_scenario, with_changes
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.radio import radio_of
from lostlink.flight.figure import draw_probability_of_delivery
from lostlink.flight.shown.bins_table import bins_tables
from lostlink.flight.summary import TickWatch, Timing, expectation_lines, summarise
from lostlink.reading.lengths import recorded_payload_bytes
from lostlink.redecision.redecide import redecide
from lostlink.redecision.rewrite import write_run
from tests.unit.bridge.record.runs import RunContent, make_run
from tests.unit.lostlink.replay.flown import flown, scenario_of

SCENARIO = read_scenario("separation")


def row(start_m: float, sent: int, measured: float, low: float = 0.4, high: float = 0.6) -> dict[str, Any]:
    ends = {"tx": "0", "rx": "1", "distance_min_m": start_m, "distance_max_m": start_m + 20}
    counts = {"sent": sent, "delivered": int(sent * measured), "measured": measured}
    return {**ends, **counts, "predicted": 0.5, "ci99": [low, high]}


def check(name: str, chance: float) -> dict[str, Any]:
    judged = {"name": name, "size": 100, "found": 1.0, "chance": chance, "passed": chance >= 1e-3}
    return judged | {"wrong": "2 dB off", "power": 1.0, "sees": True}


def summary_of(
    path: Path,
    bins: list[dict[str, Any]],
    ending: str = "done",
    checks: list[dict[str, Any]] | None = None,
    scenario: Scenario = SCENARIO,
) -> dict[str, Any]:
    sent, delivered = (sum(b[k] for b in bins) for k in ("sent", "delivered"))
    links = [
        {
            "radio": "main",
            "tx": "0",
            "rx": "1",
            "sent": sent,
            "delivered": delivered,
            "lost": {"channel_erasure": sent - delivered},
        }
    ]
    (path / LEDGER).write_text(
        json.dumps({"links": links, "bins": bins, "refused": {}, "checks": checks or [], "unjudged": []})
    )
    return summarise(scenario, RunDirectory(path), Timing(100.0, 10.0), ending)


def test_the_time_of_a_run_counts_from_its_first_tick_after_0() -> None:
    ticks = TickWatch()
    assert ticks.timing(0) == Timing(0.0, 0.0)
    ticks.tick(0, 100.0)  # and then it waits for an autopilot that somebody starts
    assert ticks.timing(0) == Timing(0.0, 0.0)
    for tick in range(1, 21):
        ticks.tick(tick * 500_000_000, 160.0 + tick * 0.25)
    timing = ticks.timing(10_000_000_000)
    assert (timing.sim_duration_s, timing.wall_duration_s, timing.real_time_factor) == (10.0, 4.75, 2.0)


def test_a_run_passes_if_all_checks_do(tmp_path: Path) -> None:
    good, bad = check("losses", 0.2), check("level of the powers", 1e-5)
    verdict = summary_of(tmp_path, [row(0, 50, 0.5)], checks=[good, good])["verdict"]
    assert verdict == "pass: 2 checks of draws against the model; 25 of 50 packets delivered"
    verdict = summary_of(tmp_path, [row(0, 50, 0.5)], checks=[good, bad])["verdict"]
    assert verdict.startswith("fail: 1 of 2 checks against the model: level of the powers (chance 1e-05)")


@pytest.mark.parametrize(
    ("changes", "checked", "names"),
    [
        ({}, "base loss", []),
        ({"radio": "wifi-2.4"}, "base loss", []),
        ({"radio": "wifi-2.4"}, "losses", ["base loss"]),
        ({"radio": "wifi-2.4"}, "", []),
        (
            {"nodes.1.radio": "wifi-2.4", "radio": {"preset": "wifi-2.4", "base_loss": 0}},
            "losses",
            ["base loss"],
        ),
        ({"networks": {"video": "wifi-5.8"}}, "main: losses", ["video: base loss"]),
        ({"networks": {"video": "wifi-5.8"}}, "video: base loss", []),
    ],
)
def test_a_base_loss_that_nobody_counted_is_told(
    tmp_path: Path, changes: dict[str, Any], checked: str, names: list[str]
) -> None:
    """As of agents that take it out of the radio in their process."""
    checks = [check(checked, 0.2)] if checked else []
    summary = summary_of(tmp_path, [row(0, 50, 0.5)], checks=checks, scenario=with_changes(SCENARIO, changes))
    assert [item["name"] for item in summary["unjudged"]] == names
    for name in names:
        assert f"not judged: {name} (the radio has one, and no packet was counted)" in summary["verdict"]


def test_bins_alone_fail_no_run(tmp_path: Path) -> None:
    summary = summary_of(tmp_path, [row(0, 50, 0.9)], checks=[check("losses", 0.2)])
    assert (summary["bins_judged"], summary["bins_within"]) == (1, 0)
    assert summary["outcome"] == "pass"


def test_nothing_to_judge(tmp_path: Path) -> None:
    summary = summary_of(tmp_path, [row(0, 49, 0.9)])
    assert summary["bins_judged"] == 0
    assert summary["outcome"] == "none"
    assert summary["verdict"] == "no verdict: nothing was drawn; 44 of 49 packets delivered"


def test_interrupted_run_has_no_verdict(tmp_path: Path) -> None:
    summary = summary_of(tmp_path, [row(0, 50, 0.5)], "interrupted")
    assert (summary["outcome"], summary["verdict"]) == (
        "interrupted",
        "interrupted: 25 of 50 packets delivered",
    )


def test_required_keys_and_real_time_factor(tmp_path: Path) -> None:
    summary = summary_of(tmp_path, [row(0, 50, 0.5)])
    required = "scenario seed autopilot speed sim_duration_s wall_duration_s real_time_factor links bins checks verdict"
    assert set(required.split()) <= set(summary)
    assert summary["real_time_factor"] == pytest.approx(10.0)


def test_what_needs_a_table_that_cannot_be_read_says_so_and_the_rest_is_judged(tmp_path: Path) -> None:
    """The truth is damaged: who heard whom, and how it ended, is known all the same."""
    run = make_run(tmp_path / "run")
    TRUTH.parquet_path(run).write_bytes(b"PAR1")
    (run / LEDGER).write_text(
        json.dumps({"links": [], "bins": [], "refused": {}, "checks": [], "unjudged": []})
    )
    expectations = [
        {"type": "separation", "at_least_m": 0.5},
        {"type": "delivery", "at_least": 1.0},
        {"type": "ending", "ending": "done"},
    ]
    scenario = read_scenario("separation", {"expectations": expectations})
    summary = summarise(scenario, RunDirectory(run), Timing(1.0, 1.0), "done")
    assert [row["passed"] for row in summary["expectations"]] == [False, True, True]
    first, *others = expectation_lines(summary)
    assert first.startswith("FAILED: ")
    assert f"cannot be judged: {TRUTH.parquet_path(run)}: damaged: " in first
    assert all(line.startswith("ok: ") for line in others)


def test_figure_is_a_picture(tmp_path: Path) -> None:
    summary = summary_of(tmp_path, [row(20.0 * i, 50, 0.5) for i in range(5)])
    draw_probability_of_delivery(summary, radio_of(SCENARIO), tmp_path / "p.png")
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")


def test_verdict_says_who_had_not_finished(tmp_path: Path) -> None:
    summary_of(tmp_path, [row(0, 50, 0.5)])
    summary = summarise(SCENARIO, RunDirectory(tmp_path), Timing(12.0, 1.0), "duration", ["1"])
    assert summary["verdict"].endswith("; node 1 had not finished")
    assert summary["unfinished"] == ["1"]


def test_a_record_is_summed_up_in_parts_as_that_of_many_ua_is_larger_than_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reader, "READ_ROWS", 256)
    scenario = scenario_of("hata-qpsk", [str(number) for number in range(12)])
    run = RunDirectory(flown(tmp_path / "run", scenario, 150, scale=0.01))
    summed_up(scenario, run)
    tracemalloc.start()
    try:
        summary = summed_up(scenario, run)
        radio = radio_of(scenario)
        assert recorded_payload_bytes(run.path, scenario, radio) == 40
        peak_bytes = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert summary["air"][0]["packets"] == 12 * 150
    rows = 12 * 11 * 150
    assert peak_bytes < 100 * rows


def summed_up(scenario: Scenario, run: RunDirectory) -> dict[str, Any]:
    return summarise(scenario, run, Timing(3.0, 1.0), "duration")


@pytest.mark.parametrize("is_finished", [True, False], ids=["Parquet", "journals"])
def test_of_a_radio_that_was_killed_the_tables_are_counted(tmp_path: Path, is_finished: bool) -> None:
    def lose(made: RunContent) -> None:
        made.change_row(0, fate="out_of_range")
        made.change_row(2, rx="all", packets=3, fate="transport")

    run = RunDirectory(make_run(tmp_path / "run", lose, is_finished=is_finished))
    run.write(SCENARIO, "")
    summary = summarise(SCENARIO, run, Timing(1.0, 1.0), "failed")
    assert summary["links"] == [
        {
            "radio": "main",
            "tx": "0",
            "rx": "1",
            "sent": 22,
            "delivered": 18,
            "lost": {"out_of_range": 1, "transport": 3},
        },
        {"radio": "main", "tx": "1", "rx": "0", "sent": 20, "delivered": 20, "lost": {}},
    ]
    assert summary["verdict"] == "broke off: 38 of 42 packets delivered"


def test_of_a_table_that_is_damaged_nothing_is_counted(tmp_path: Path) -> None:
    run = RunDirectory(make_run(tmp_path / "run"))
    run.write(SCENARIO, "")
    DELIVERIES.parquet_path(run.path).write_bytes(b"PAR1")
    summary = summarise(SCENARIO, run, Timing(1.0, 1.0), "failed")
    assert (summary["links"], summary["verdict"]) == ([], "broke off: no link was recorded")


def shown(summary: dict[str, Any]) -> str:
    console = Console(width=200, record=True, file=io.StringIO())
    for table in bins_tables(summary):
        console.print(table)
    return " ".join(console.export_text().split())


def test_a_table_of_a_long_flight_has_rows_of_several_bins(tmp_path: Path) -> None:
    """9 km in bins of 20 m; a row has the counts of all of its bins, and names a link once."""
    bins = [row(20 * number, 100, 0.7) for number in range(450)]
    lines = next(iter(bins_tables(summary_of(tmp_path, bins)))).columns
    distances, sent, *_, outside = ([*column.cells] for column in lines)
    assert (distances[0], distances[-1], len(distances)) == ("0-320", "8960-9280", 29)
    assert (sent[0], sent[-1]) == ("1600", "200")
    assert set(outside) == {"0 -> 1"}


def test_each_network_has_a_table_of_its_own(tmp_path: Path) -> None:
    """A ground station's modem loses what the agents' radio, on which nothing is lost, does not."""
    bins = [row(0, 100, 1.0) | {"radio": "main"}, row(0, 50, 0.4) | {"radio": "telemetry", "ci99": None}]
    text = shown(summary_of(tmp_path, bins))
    main, telemetry = text.split("telemetry: Probability of delivery by distance")
    assert main.startswith("main: Probability of delivery by distance, all links distance")
    assert "0-20 100 100 1.000" in main
    assert "no intervals" in telemetry
    assert "0-20 50 20 0.400" in telemetry
    assert shown(summary_of(tmp_path, bins[1:])).startswith("telemetry: Probability of delivery")


def test_intervals_of_independent_packets_are_not_held_against_those_that_share_their_draws(
    tmp_path: Path,
) -> None:
    alone, shared = row(0, 100, 0.7), row(0, 100, 0.7) | {"ci99": None}
    summary = summary_of(tmp_path, [alone])
    assert (summary["bins_judged"], summary["bins_within"]) == (1, 0)
    assert "0 -> 1" in shown(summary)
    summary = summary_of(tmp_path, [shared])
    assert (summary["bins_judged"], summary["bins_within"]) == (0, 0)
    assert "packets share shadowing or fading: no intervals" in shown(summary)
    assert "0 -> 1" not in shown(summary)


def test_a_table_of_transmissions_is_told_from_one_of_packets(tmp_path: Path) -> None:
    said = "of first transmissions, as if alone on the air"
    assert said in shown(summary_of(tmp_path, [row(0, 100, 0.7) | {"of": "transmissions"}]))
    assert said not in shown(summary_of(tmp_path, [row(0, 100, 0.7)]))


@pytest.mark.parametrize(
    ("radio", "shared"),
    [
        ("corrected", False),
        ("{preset: wifi-2.4, medium: {model: ideal}}", True),
        ("{preset: corrected, fading: {model: rician, k_db: 3.0, coherence: doppler}}", True),
        ("{preset: perfect, bursts: {model: gilbert-elliott, mean_good_s: 1, mean_bad_s: 1}}", True),
    ],
)
def test_a_run_has_intervals_where_its_packets_are_independent(
    tmp_path: Path, radio: str, shared: bool
) -> None:
    run = RunDirectory(flown(tmp_path / "run", scenario_of(radio, ("0", "1")), 3))
    again = tmp_path / "again"
    write_run(redecide(run.path), again)
    bins = json.loads((again / LEDGER).read_text())["bins"]
    assert bins
    assert {each["ci99"] is None for each in bins} == {shared}


def test_a_row_names_some_links_and_counts_the_others(tmp_path: Path) -> None:
    many = [row(0, 100, 0.7) | {"tx": str(tx), "rx": "9"} for tx in range(8)]
    assert "0 -> 9, 1 -> 9, 2 -> 9 and 5 more" in shown(summary_of(tmp_path, many))
