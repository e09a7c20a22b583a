"""Nodes of kinds: what they may say, and which roles they have."""

from __future__ import annotations

import pytest

from bridge.scenario.file import ScenarioError, parse_scenario
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.ground_track import GroundTrack
from bridge.scenario.resolve.radio import radios_of

HEAD = """schema: 1
name: small
duration_s: 5
origin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600}
radio: moon2020
nodes:
  - {id: 0, agent: {type: still}}
"""


def scenario(*nodes: str) -> Scenario:
    return parse_scenario(HEAD + "".join(f"  - {node}\n" for node in nodes), "small.yaml")


def mistake(*nodes: str) -> str:
    with pytest.raises(ScenarioError) as caught:
        scenario(*nodes)
    return str(caught.value)


def test_roles_follow_from_kind_and_agent() -> None:
    it = scenario(
        "{id: gcs, kind: ground, agent: {type: still}}",
        "{id: probe, kind: ground, agent: {type: free}}",
        "{id: 1, agent: {type: free}}",
    )
    assert it.stations == ("0", "gcs", "probe", "1")
    assert it.regulated == ("0", "gcs", "1")
    assert [node.node for node in it.nodes if node.has_agent] == ["0", "gcs"]
    assert [ua.node for ua in it.ua] == ["0", "1"]


def test_outages_of_a_radio_follow_each_other() -> None:
    it = scenario(
        "{id: gcs, kind: ground, radio_off: [{from_s: 2.5, to_s: 3}, {from_s: 3}], agent: {type: still}}"
    )
    assert [(each.from_ns, each.to_ns) for each in it.ground[0].radio_off] == [
        (2_500_000_000, 3_000_000_000),
        (3_000_000_000, None),
    ]
    assert it.ua[0].radio_off == ()
    assert Scenario.from_yaml(it.to_yaml()) == it


@pytest.mark.parametrize(
    ("outages", "key", "says"),
    [
        ("[{from_s: 2, to_s: 2}]", "radio_off.0.to_s", "has to be above from_s, 2 (got 2)"),
        ("[{from_s: 2}, {from_s: 3}]", "radio_off.1.from_s", "has to be at or after to_s"),
        ("[{from_s: 2, to_s: 5}, {from_s: 3}]", "radio_off.1.from_s", "has to be at or after to_s"),
        ("[{to_s: 3}]", "radio_off.0.from_s", "is required"),
        ("[{from_s: -1}]", "radio_off.0.from_s", "greater than or equal to 0"),
        ("[{from_s: 1, until_s: 3}]", "radio_off.0.until_s", "from_s, to_s"),
    ],
)
def test_outages_that_cannot_be_are_refused(outages: str, key: str, says: str) -> None:
    for name, node in (("gcs", "id: gcs, kind: ground"), ("1", "id: 1")):
        text = mistake(f"{{{node}, radio_off: {outages}, agent: {{type: still}}}}")
        assert f"nodes.{name}.{key}:" in text
        assert says in text


def test_an_emitter_has_no_radio_to_switch() -> None:
    emitter = "{id: jam, kind: emitter, frequency_hz: 2.4e+9, power_dbm: 3, radio_off: [{from_s: 1}]}"
    assert "nodes.jam.radio_off: unknown key" in mistake(emitter)


def test_what_is_read_back_is_the_same() -> None:
    it = scenario(
        "{id: gcs, kind: ground, place: {north_m: 7}, radio: corrected, agent: {type: free}}",
        "{id: van, kind: ground, track: [{sim_time_s: 0}, {sim_time_s: 3, north_m: 4}], agent: {type: still}}",
    )
    assert Scenario.from_yaml(it.to_yaml()) == it


@pytest.mark.parametrize(
    ("node", "key", "says"),
    [
        ("{id: gcs, kind: balloon, agent: {type: still}}", "nodes.gcs.kind", "has to be one of: ua, ground"),
        (
            "{id: gcs, kind: ground, agent: {type: hold, altitude_m: 4}}",
            "nodes.gcs.agent",
            "still, free, own",
        ),
        (
            "{id: gcs, kind: ground, airframe: f450, agent: {type: still}}",
            "nodes.gcs.airframe",
            "place, track",
        ),
        ("{id: a/b, kind: ground, agent: {type: still}}", "nodes.1.id", "letters, digits"),
        ("{id: gcs, kind: ground, radio: nope, agent: {type: still}}", "nodes.gcs.radio", "nope"),
        ("{id: '0', kind: ground, agent: {type: still}}", "nodes", "id 0 is used more than once"),
        ("{id: all, kind: ground, agent: {type: still}}", "nodes", "id: all is the address"),
        (
            "{id: gcs, kind: ground, radio: telemetry-915, agent: {type: still}}",
            "nodes.gcs.radio",
            "its frequency is 9.15e+08 Hz, that of the run's radio 2.412e+09 Hz",
        ),
        ("{id: gcs, kind: ground, place: {north_m: 1.0e+300}, agent: {type: still}}", "nodes.gcs", "1000000"),
        (
            "{id: gcs, kind: ground, place: {north_m: 1}, track: [{sim_time_s: 0}], agent: {type: still}}",
            "nodes.gcs",
            "place and track: give one of them",
        ),
        (
            "{id: gcs, kind: ground, track: [{sim_time_s: 3}, {sim_time_s: 3}], agent: {type: still}}",
            "nodes.gcs",
            "track.1.sim_time_s: has to be above that of the point before, 3 (got 3)",
        ),
    ],
)
def test_mistakes_are_named(node: str, key: str, says: str) -> None:
    text = mistake(node)
    assert key in text
    assert says in text


def test_a_fleet_needs_a_ua() -> None:
    text = HEAD.replace("{id: 0, agent", "{id: gcs, kind: ground, agent")
    with pytest.raises(ScenarioError, match="there has to be a UA"):
        parse_scenario(text, "small.yaml")


def test_a_node_has_its_own_radio_or_that_of_all() -> None:
    it = scenario("{id: gcs, kind: ground, radio: {preset: moon2020, mtu_bytes: 99}, agent: {type: still}}")
    radios = radios_of(it)
    assert radios["gcs"].config.mtu_bytes == 99
    assert radios["0"].config.mtu_bytes != 99


def test_a_track_is_straight_from_point_to_point_and_stands_at_its_ends() -> None:
    points = "[{sim_time_s: 1, north_m: 0}, {sim_time_s: 3, north_m: 10, east_m: 4, height_m: 12}]"
    it = scenario(f"{{id: van, kind: ground, track: {points}, agent: {{type: still}}}}")
    track = GroundTrack(it, it.ground[0])
    assert track.at(0).position_ned_m == (0.0, 0.0, -2.0)
    assert track.at(0).velocity_ned_mps == (0.0, 0.0, 0.0)
    middle = track.at(2_000_000_000)
    assert middle.position_ned_m == (5.0, 2.0, -7.0)
    assert middle.velocity_ned_mps == (5.0, 2.0, -5.0)
    assert track.at(9_000_000_000).position_ned_m == (10.0, 4.0, -12.0)
    assert track.at(9_000_000_000).position.alt_amsl_m == pytest.approx(1612.0, abs=0.01)
