"""What a run says of its air, from scenario to summary and report."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lostlink import Run
from lostlink.report.content import content_of
from tests import warm
from tests.integration.bridge.radio.test_air import FLAT, node

SIZE_BYTES, PER_TICK = 1400, 10
OFFERED_BPS = 6 * 20 * PER_TICK * 8 * SIZE_BYTES
"""Six nodes with 200 packets a second each: 13.4 Mb/s, of which each hears five sixths."""


@pytest.fixture
def flown(tmp_path: Path, free_slot: Callable[[int], int]) -> Callable[[Any], Run]:
    def flown(radio: Any) -> Run:
        nodes = [node(n, 20.0 * n, period_s=0.05, count=PER_TICK, size=SIZE_BYTES) for n in range(6)]
        scenario = {
            "schema": 1,
            "name": "told",
            "duration_s": 4.0,
            "figure": False,
            "origin": {"lat_deg": 37.0, "lon_deg": 127.0, "alt_amsl_m": 50.0},
            "fdm": {"standin_rate_hz": 100},
            "transmit": FLAT,
            "ports": {"first_slot": free_slot(1), "zenoh": 0},
            "radio": radio,
            "nodes": nodes,
        }
        return warm.flown(scenario, tmp_path / "run")

    return flown


@pytest.mark.slow
def test_more_than_a_radio_can_carry_is_warned_of_with_ideal(flown: Callable[[Any], Run]) -> None:
    """Eleven megabits a second over 64 kb/s passed without a word."""
    run = flown({"preset": "telemetry-915", "medium": {"model": "ideal"}})
    (air,) = run.summary["air"]
    assert (air["medium"], air["takes_time"], air["use_share"]) == ("ideal", False, None)
    assert air["offered_bps"] == pytest.approx(OFFERED_BPS, rel=0.02)
    assert air["share"] == pytest.approx(OFFERED_BPS * (SIZE_BYTES + 8) / SIZE_BYTES / 64e3, rel=0.02)
    assert 0.9 < air["received_most_bps"] / (OFFERED_BPS * 5 / 6) <= 1.01
    (warning,) = run.summary["warnings"]
    assert warning.startswith("the medium is ideal, where packets take no time: node ")
    assert "Mbit/s over a radio of 64 kbit/s" in warning
    assert run.verdict.startswith("pass")
    assert "; medium ideal, offered 2" in run.verdict
    (shown,) = content_of(run)["air"]
    assert shown["warning"] == warning
    assert shown["series"]["offered_share"][1:3] == pytest.approx([air["share"]] * 2, rel=0.01)
    assert shown["series"]["delay_p95_s"] is None


def test_on_a_medium_use_waits_delays_and_causes_are_told(flown: Callable[[Any], Run]) -> None:
    """A slot of 200 ms has room for one packet of 175 ms (8 * 1400 / 64 kb/s); a queue of 20 empties in 24 s."""
    medium = {"model": "tdma", "slot_s": 0.2, "queue": {"packets": 20}}
    run = flown({"preset": "telemetry-915", "medium": medium})
    (air,) = run.summary["air"]
    assert air["capacity_bps"] == pytest.approx(8 * SIZE_BYTES / (6 * 0.2), rel=0.01)
    assert air["share"] == pytest.approx(OFFERED_BPS / (8 * SIZE_BYTES / 0.2), rel=0.02)
    frames = run.packets[run.packets.started_ns >= 0].drop_duplicates(["tx", "started_ns"])
    assert air["use_share"] == pytest.approx((frames.ended_ns - frames.started_ns).sum() / 4.05e9)
    assert len(frames) in range(15, 21)  # of 20 slots in the 4.05 s to the end of the last tick
    rows = run.packets[run.packets.fate == "delivered"]
    assert air["delay_p50_s"] == pytest.approx(((rows.arrived_ns - rows.sim_time_ns) / 1e9).median(), rel=0.2)
    assert 0.0 < air["wait_p50_s"] < air["delay_p50_s"] < air["delay_p95_s"] < 4.1
    (warning,) = run.summary["warnings"]
    assert (
        f"{air['lost_waiting'] - air['waiting_at_end']} receptions were lost for want of time on the air"
        in warning
    )
    content = content_of(run)
    (shown,) = content["air"]
    assert max(shown["series"]["use_share"]) <= 1.0
    assert shown["series"]["delay_p95_s"][-1] > shown["series"]["delay_p95_s"][0]
    assert (
        content["totals"]["lost"]["queue_full"] + content["totals"]["lost"]["run_ended"]
        == air["lost_waiting"]
    )
