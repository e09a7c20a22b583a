"""A network whose nodes have several bit rates, from scenario to record, report and redecision."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.reader import read_columns
from bridge.scenario.file import parse_scenario
from bridge.scenario.mistakes.error import ScenarioError
from bridge.scenario.model import Scenario
from lostlink.plan.plan import plan_of
from lostlink.plan.radios.networks import rates_that_differ
from lostlink.reading.air.account import tallies_of
from lostlink.reading.rows import RecordedDeliveries
from lostlink.redecision.redecide import redecide
from tests.unit.lostlink.replay.flown import TICK_NS, Sent, flown

TEXT = """\
schema: 1
name: mixed
duration_s: 600
transmit: {every_ticks: 20}
origin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600.0}
radio: {preset: PRESET, bit_rate_bps: 64e+3, medium: MEDIUM}
nodes:
  - {id: 0, radio: {preset: PRESET, bit_rate_bps: FIRST, medium: MEDIUM}, home: {north_m: 10}, agent: {type: still}}
  - {id: 1, radio: {preset: PRESET, bit_rate_bps: SECOND, medium: MEDIUM}, agent: {type: still}}
"""
MEDIA = {
    "airtime": "{model: airtime, preamble_s: 0.001, header_bytes: 12}",
    "tdma": "{model: tdma, slot_s: 0.2, preamble_s: 0.001, header_bytes: 12}",
}


def scenario_with(preset: str, medium: str, *rates_bps: float) -> Scenario:
    text = TEXT.replace("PRESET", preset).replace("MEDIUM", medium)
    for name, rate_bps in zip(("FIRST", "SECOND"), rates_bps, strict=True):
        text = text.replace(name, repr(rate_bps))
    return parse_scenario(text, "mixed.yaml")


def frame_s(rate_bps: float) -> float:
    """Of 100 bytes and 12 of header after a preamble of 1 ms."""
    return 0.001 + 8 * 112 / rate_bps


@pytest.mark.slow
@pytest.mark.parametrize("medium", MEDIA)
@pytest.mark.parametrize("rates_bps", [(64e3, 6.4e3), (6.4e3, 64e3)])
def test_each_nodes_frames_last_at_its_own_rate(
    medium: str, rates_bps: tuple[float, float], tmp_path: Path
) -> None:
    scenario, ticks, every = scenario_with("xbee-900hp", MEDIA[medium], *rates_bps), 240, 20
    run = flown(
        tmp_path / "run",
        scenario,
        ticks,
        lambda number: [] if number % every else [Sent(node, length=100) for node in "01"],
        scale=0.5,
    )
    rows = read_columns(run, DELIVERIES)
    lasted_ns = rows["ended_ns"] - rows["started_ns"]
    for node, rate_bps in zip("01", rates_bps, strict=True):
        mine = (rows["tx"] == node) & (rows["started_ns"] >= 0)
        assert mine.sum() == ticks // every
        assert np.unique(lasted_ns[mine]).tolist() == [round(frame_s(rate_bps) * 1e9)]
    assert redecide(run).comparison.is_same

    end_ns = ticks * TICK_NS
    [tally] = tallies_of(RecordedDeliveries(run, ("0", "1")), scenario)
    account = tally.account(end_ns)
    share = (ticks // every) * sum(map(frame_s, rates_bps)) / (end_ns / 1e9)
    assert account.use_share == pytest.approx(share, rel=1e-6)
    if medium == "airtime":
        assert account.share == pytest.approx(share, rel=1e-6)


def test_the_plan_reckons_each_node_at_its_own_rate() -> None:
    medium = MEDIA["airtime"].replace(
        "}", ", max_length_bytes: 1000}"
    )  # xbee-900hp's are shorter than a package
    plan = plan_of(scenario_with("xbee-900hp", medium, 64e3, 6.4e3))
    payload = plan.load.nodes[0].payload_bytes
    assert payload is not None
    expected = [0.001 + 8 * (payload + 12) / rate_bps for rate_bps in (64e3, 6.4e3)]
    assert [each.airtime_share for each in plan.load.nodes] == pytest.approx(expected)
    assert plan.load.airtime_share == pytest.approx(sum(expected))


@pytest.mark.parametrize(
    ("preset", "medium"),
    [
        ("wifi-2.4", "{model: csma}"),
        ("telemetry-915", "{model: sik}"),
        ("elrs-2.4-333full", "{model: elrs}"),
        ("xbee-900hp", "{model: airtime, bit_rate_bps: 32e+3}"),
    ],
)
def test_a_medium_with_one_rate_for_all_refuses_radios_of_several(preset: str, medium: str) -> None:
    wrong = (
        r"mixed.yaml:\d+: nodes.1.radio: its bit_rate_bps is 6400 bit/s, that of the first 64000 bit/s: with"
    )
    with pytest.raises(ScenarioError, match=wrong):
        scenario_with(preset, medium, 64e3, 6.4e3)
    scenario_with(preset, medium, 6.4e3, 6.4e3)


def test_a_medium_with_another_rate_than_its_radios_is_warned_of() -> None:
    scenario = scenario_with("xbee-900hp", "{model: airtime, bit_rate_bps: 32e+3}", 64e3, 64e3)
    assert list(rates_that_differ(scenario)) == [
        "radio of network main: frames last as long as at 0.032 Mb/s (medium.bit_rate_bps), and have the errors of "
        "0.064 Mb/s (bit_rate_bps)"
    ]


@pytest.mark.parametrize(("error", "has_errors_of_a_rate"), [("lossless", False), ("uncoded-awgn", True)])
def test_radios_without_errors_have_none_of_another_rate(error: str, has_errors_of_a_rate: bool) -> None:
    medium = f"{{model: airtime, bit_rate_bps: 32e+3}}, error: {{model: {error}}}"
    found = list(rates_that_differ(scenario_with("perfect", medium, 64e3, 64e3)))
    assert bool(found) is has_errors_of_a_rate


def test_a_medium_of_ones_own_that_wants_one_rate_refuses_several(tmp_path: Path) -> None:
    (tmp_path / "plain.py").write_text(
        "from channel.access.media.airtime import AirTime\n"
        "from channel.access.settings.base import Serial\n\n\n"
        "class OneRate(Serial):\n"
        "    def open(self, surroundings):\n"
        "        timing = self.timing(surroundings)\n"
        "        return AirTime(surroundings.world, timing, self.queue.limits, self.hearing(surroundings))\n"
    )
    medium = f"{{class: '{tmp_path / 'plain.py'}:OneRate'}}"
    with pytest.raises(
        ScenarioError, match="one bit rate for all, and node 0 has 64000 bit/s, node 1 6400 bit/s"
    ):
        scenario_with("xbee-900hp", medium, 64e3, 6.4e3)
    scenario_with("xbee-900hp", medium, 6.4e3, 6.4e3)
