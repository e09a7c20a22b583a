"""The summary's verdict judges what it says it judges."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from bridge.cli.report import Timing, draw_probability_of_delivery, summarise
from bridge.radio.deliveries import LEDGER
from bridge.run.directory import RunDirectory
from bridge.scenario.file import read_scenario
from bridge.scenario.resolve_radio import radio_of

SCENARIO = read_scenario("separation")


def row(start_m: float, sent: int, measured: float, low: float = 0.4, high: float = 0.6) -> dict[str, Any]:
    ends = {"tx": "0", "rx": "1", "distance_min_m": start_m, "distance_max_m": start_m + 20}
    counts = {"sent": sent, "delivered": int(sent * measured), "measured": measured}
    return {**ends, **counts, "predicted": 0.5, "ci99": [low, high]}


def summary_of(path: Path, bins: list[dict[str, Any]], ending: str = "done") -> dict[str, Any]:
    sent, delivered = (sum(b[k] for b in bins) for k in ("sent", "delivered"))
    links = [
        {
            "tx": "0",
            "rx": "1",
            "sent": sent,
            "delivered": delivered,
            "lost": {"channel_erasure": sent - delivered},
        }
    ]
    (path / LEDGER).write_text(json.dumps({"links": links, "bins": bins, "refused": {}}))
    return summarise(SCENARIO, RunDirectory(path), Timing(100.0, 10.0), ending)


def test_pass_needs_95_percent_of_the_bins_with_50_packets(tmp_path: Path) -> None:
    good = [row(20.0 * i, 50, 0.5) for i in range(19)]
    assert summary_of(tmp_path, [*good, row(400, 50, 0.9)])["verdict"].startswith("pass: 19 of 20")
    assert summary_of(tmp_path, [*good[1:], row(400, 50, 0.9)])["verdict"].startswith("fail: 18 of 19")


def test_bins_with_fewer_packets_are_not_judged(tmp_path: Path) -> None:
    summary = summary_of(tmp_path, [row(0, 49, 0.9)])
    assert summary["bins_judged"] == 0
    assert summary["verdict"].startswith("no verdict")


def test_interrupted_run_has_no_verdict(tmp_path: Path) -> None:
    assert summary_of(tmp_path, [row(0, 50, 0.5)], "interrupted")["verdict"].startswith("interrupted")


def test_required_keys_and_real_time_factor(tmp_path: Path) -> None:
    summary = summary_of(tmp_path, [row(0, 50, 0.5)])
    required = "scenario seed autopilot speed sim_duration_s wall_duration_s real_time_factor links bins verdict schema"
    assert set(required.split()) <= set(summary)
    assert summary["real_time_factor"] == pytest.approx(10.0)


def test_figure_is_a_picture(tmp_path: Path) -> None:
    summary = summary_of(tmp_path, [row(20.0 * i, 50, 0.5) for i in range(5)])
    draw_probability_of_delivery(summary, radio_of(SCENARIO), tmp_path / "p.png")
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")


def test_verdict_says_who_had_not_finished(tmp_path: Path) -> None:
    summary_of(tmp_path, [row(0, 50, 0.5)])
    summary = summarise(SCENARIO, RunDirectory(tmp_path), Timing(12.0, 1.0), "duration", ["1"])
    assert summary["verdict"].endswith("; UA 1 had not finished")
    assert summary["unfinished"] == ["1"]
