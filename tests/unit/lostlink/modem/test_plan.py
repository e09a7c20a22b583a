"""The link of a recorded run: its nodes' radios and places, its seed."""

from __future__ import annotations

from pathlib import Path

import pytest

from bridge.modem.pair import AIR, GROUND
from bridge.modem.radio_link import RadioLink
from bridge.run.directory import SCENARIO_FILE
from bridge.scenario.file import parse_scenario, read_scenario
from lostlink.modem.plan import ends_of, plan_of_run
from tests.unit.bridge.modem.frames import frame_of
from tests.unit.bridge.record.runs import TICK_NS, make_run


@pytest.fixture
def run(tmp_path: Path) -> Path:
    path = make_run(tmp_path / "a")
    scenario = read_scenario("separation", {"radio": "sik-433", "seed": 11})
    (path / SCENARIO_FILE).write_text(scenario.to_yaml(), encoding="utf-8")
    return path


def test_places_radios_and_seed_are_those_of_the_run(run: Path) -> None:
    plan = plan_of_run(run, ("1", "0"), baud=9600)
    assert (plan.nodes, plan.seed, plan.baud, list(plan.bases)) == (("1", "0"), 11, 9600, [])
    assert plan.radios[GROUND].config.name == "sik-433"
    for track, node in zip(plan.tracks, (1, 0), strict=True):
        # the record has nodes that go north with 1 m/s, at 10 m
        assert [sample.at_ns for sample in track.samples] == [n * TICK_NS for n in range(20)]
        assert track.samples[4].position_ned_m == pytest.approx((0.2 + node, 0.0, -10.0))
        assert track.samples[4].attitude_wxyz == pytest.approx((1.0, 0.0, 0.0, 0.0))


def test_the_link_of_a_run_carries_frames(run: Path) -> None:
    link = RadioLink(plan_of_run(run))
    link.receive(AIR, frame_of(60, 1), 0)
    outputs = link.advance(2_000_000_000)
    assert [(end, data) for end, (_, data) in outputs] == [(GROUND, frame_of(60, 1))]


@pytest.mark.parametrize(
    ("nodes", "said"),
    [
        (("0", "7"), "no radio at node 7 on main; there are 0, 1"),
        (("1", "1"), "two that differ"),
        (("1",), "two that differ"),
    ],
)
def test_nodes_that_cannot_be(run: Path, nodes: tuple[str, ...], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        plan_of_run(run, nodes)


ON_THE_AIR = """\
schema: 1
name: air
duration_s: 10
origin: {lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690}
radio: perfect
networks: {telemetry: sik-433}
nodes:
  - {id: 0, modems: {telemetry: {serial: 1}}, agent: {type: still}}
  - {id: 1, modems: {telemetry: {serial: 1}}, agent: {type: still}}
"""
MODEMS = Path(__file__).parents[3] / "data" / "modems.yaml"


@pytest.mark.parametrize(
    ("network", "radio"), [(None, "sik-433"), ("main", "perfect"), ("telemetry", "sik-433")]
)
def test_the_radio_is_that_of_the_modems_unless_asked_for(run: Path, network: str | None, radio: str) -> None:
    scenario = parse_scenario(ON_THE_AIR, "scenario", run, {})
    (run / SCENARIO_FILE).write_text(scenario.to_yaml(), encoding="utf-8")
    plan = plan_of_run(run, ("0", "1"), network=network)
    assert [each.config.name for each in plan.radios] == [radio, radio]


@pytest.mark.parametrize(
    ("nodes", "network", "ends"),
    [
        (("gcs", "1"), None, ("far", ("gcs", "1"))),
        (None, "far", ("far", ("gcs", "0"))),
        (None, "near", ("near", ("gcs", "0"))),
        (None, "main", ("main", ("0", "1"))),
    ],
)
def test_ends_are_where_modems_are(
    nodes: tuple[str, ...] | None, network: str | None, ends: tuple[str, tuple[str, str]]
) -> None:
    found, pair = ends_of(read_scenario(str(MODEMS), {}), nodes, network)
    assert (found, tuple(pair)) == ends


@pytest.mark.parametrize(
    ("nodes", "network", "said"),
    [
        (("gcs", "0"), None, "there are modems on near and far: choose a network with --radio"),
        (None, None, "there are modems on near and far: choose a network with --radio"),
        (None, "moon", "no radio network moon; there are main, near, far"),
        (("gcs", "1"), "moon", "no radio network moon"),
    ],
)
def test_networks_that_cannot_be(nodes: tuple[str, ...] | None, network: str | None, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        ends_of(read_scenario(str(MODEMS), {}), nodes, network)
