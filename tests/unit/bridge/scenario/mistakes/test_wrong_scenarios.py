"""Wrong scenarios: each is refused with file, line, key, and what would be right, in lines that all begin alike."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bridge.scenario.file import ScenarioError, parse_scenario

RIGHT = """\
schema: 1
name: mine
seed: 1
speed: max
duration_s: 60
origin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600}
radio: moon2020
wind: calm
nodes:
  - id: 0
    airframe: f450
    home: {north_m: 0}
    agent: {type: hold, altitude_m: 40}
  - id: 1
    home:
      north_m: 5
    agent:
      type: out_and_back
      altitude_m: 40
      distance_m: 600
expectations:
  - {type: delivery, from: 0, to: 1, at_least: 0.9}
"""


def test_the_scenario_that_is_made_wrong_is_right() -> None:
    assert len(parse_scenario(RIGHT, "mine.yaml").nodes) == 2


@pytest.mark.parametrize(
    ("old", "new", "line", "key", "says"),
    [
        ("nodes:", "ua:", 9, "ua", "did you mean nodes?"),
        ("wind: calm", "wind: 5", 8, "wind", "the name of a wind, a YAML file, or a mapping"),
        ("wind: calm", "wind: [calm]", 8, "wind", "the name of a wind, a YAML file, or a mapping"),
        ("wind: calm", "wind: clam", 8, "wind", "did you mean calm? Known are breeze, calm"),
        ("wind: calm", "wind: {constant: {speed: 3}}", 8, "wind.constant.speed", "did you mean speed_mps?"),
        ("duration_s: 60\n", "", 21, "duration_s", "add duration_s: 300"),
        ("duration_s: 60", "duration_s: 60 s", 5, "duration_s", "has to be a number (got '60 s')"),
        (
            "duration_s: 60",
            "duration_s: 1.0e+30",
            5,
            "duration_s",
            "less than or equal to 4000000 (got 1e+30)",
        ),
        ("name: mine", f"name: {'x' * 300}", 2, "name", "at most 64 characters (got 'xxx"),
        ("seed: 1", f"networks: {{{'x' * 300}: disk}}", 3, f"networks.{'x' * 300}", "at most 64 characters"),
        ("seed: 1", f"transmit: {{channel: {'x' * 65}}}", 3, "transmit.channel", "at most 64 characters"),
        (
            "  - id: 1",
            f"  - kind: ground\n    id: {'x' * 300}",
            15,
            "nodes.1.id",
            "at most 64 characters",
        ),
        (
            "  - id: 1",
            f"  - groups: [{'x' * 300}]\n    id: 1",
            14,
            "nodes.1.groups.0",
            "at most 64 characters",
        ),
        ("duration_s: 60", "duration: 60", 5, "duration", "did you mean duration_s?"),
        ("speed: max", "speed: 0", 4, "speed", "'max' or a real-time factor from 0.1"),
        ("seed: 1", "seed: one", 3, "seed", "has to be a whole number (got 'one')"),
        ("seed: 1", "seed: 1\nseed: 2", 4, "seed", "given twice, before on line 3"),
        ("schema: 1", "schema: 2", 1, "schema", "has to be 1 (got 2)"),
        ("name: mine", "name: my flight", 2, "name", "letters, digits, '_', '.' and '-'"),
        (
            "origin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600}",
            "origin: [40.0, -105.0, 1600]",
            6,
            "origin",
            "a mapping of keys to values, with lat_deg, lon_deg, alt_amsl_m",
        ),
        ("lon_deg: -105.0, ", "", 6, "origin.lon_deg", "is required, and missing"),
        ("lat_deg: 40.0", "lat_deg: 140.0", 6, "origin.lat_deg", "less than or equal to 90 (got 140.0)"),
        (
            "radio: moon2020",
            "radio: moon2002",
            7,
            "radio",
            "did you mean moon2020? Known are corrected, disk",
        ),
        (
            "radio: moon2020",
            "radio: [moon2020]",
            7,
            "radio",
            "the name of a radio preset, or a mapping with 'preset'",
        ),
        (
            "radio: moon2020",
            "radio: {preset: moon2020, noise: {floor_dbm: low}}",
            7,
            "radio.noise.floor_dbm",
            "has to be a number (got 'low')",
        ),
        (
            "radio: moon2020",
            "radio: {preset: moon2020, propagation: {model: free}}",
            7,
            "radio.propagation.model",
            "did you mean free-space?",
        ),
        (
            "radio: moon2020",
            "radio: {preset: moon2020, max_range: 300}",
            7,
            "radio.max_range",
            "did you mean max_range_m?",
        ),
        ("airframe: f450", "airframe: f45", 11, "nodes.0.airframe", "did you mean f450? Known are aerosonde"),
        ("airframe: f450", "airframes: f450", 11, "nodes.0.airframes", "did you mean airframe?"),
        (
            "home: {north_m: 0}",
            "home: [0, 0]",
            12,
            "nodes.0.home",
            "a mapping of keys to values, with north_m, east_m, heading_deg",
        ),
        ("    agent: {type: hold, altitude_m: 40}\n", "", 10, "nodes.0.agent", "add agent: {type: hold"),
        (
            "type: hold, ",
            "type: hover, ",
            13,
            "nodes.0.agent.type",
            "has to be one of: hold, out_and_back, still, free, own (got 'hover')",
        ),
        (
            "agent: {type: hold, altitude_m: 40}",
            "agent:\n      altitude_m: 40\n      type: hover",
            15,
            "nodes.0.agent.type",
            "has to be one of: hold, out_and_back, still, free, own (got 'hover')",
        ),
        ("altitude_m: 40}", "altitude: 40}", 13, "nodes.0.agent.altitude", "did you mean altitude_m?"),
        (
            "type: hold, altitude_m: 40",
            "altitude_m: 40",
            13,
            "nodes.0.agent",
            "type is missing: has to be one of: hold",
        ),
        (
            "agent: {type: hold, altitude_m: 40}",
            "agent: hold",
            13,
            "nodes.0.agent",
            "as in agent: {type: hold, altitude_m: 40}",
        ),
        ("  - id: 1", "  - id: 0", 14, "nodes.1.id", "id 0 is used more than once, first at mine.yaml:10"),
        (
            "  - id: 1",
            "  - id: gcs",
            14,
            "nodes.1.id",
            "has to be a whole number; a word is the id of a node with kind: ground or emitter (got 'gcs')",
        ),
        (
            "  - id: 1",
            "  - kind: drone\n    id: 1",
            14,
            "nodes.1.kind",
            "has to be one of: ua, ground, emitter (got 'drone')",
        ),
        ("      distance_m: 600\n", "", 17, "nodes.1.agent.distance_m", "is required, and missing"),
        ("distance_m: 600", "distance_m: -600", 20, "nodes.1.agent.distance_m", "greater than 0 (got -600)"),
        (
            "  - id: 1",
            "  - id: 1\n    count: two",
            15,
            "nodes.1.count",
            "a number of nodes from 0 to 1000 (got 'two')",
        ),
        (
            "agent: {type: hold, altitude_m: 40}",
            "agent: {type: own, class: nothing.py:Mine}",
            13,
            "nodes.0.agent.class",
            "nothing.py: no such file",
        ),
        ("to: 1", "to: 2", 22, "expectations.0.to", "no node has the id 2; there are: 0, 1"),
        ("at_least: 0.9", "at_least: 90", 22, "expectations.0.at_least", "less than or equal to 1 (got 90)"),
        ("type: delivery", "type: delivry", 22, "expectations.0.type", "did you mean delivery?"),
        ("      north_m: 5", "\tnorth_m: 5", 16, "is not YAML", "indent with spaces"),
        ("schema: 1", "extends: seperation\nschema: 1", 1, "extends", "did you mean separation?"),
        ("nodes:", "nodes: 5\nnode:", 9, "nodes", "has to be a list (got 5), as in nodes:"),
        ("seed: 1", "ports: {zenoh: 99999}", 3, "ports.zenoh", "less than or equal to 65535"),
        (
            "seed: 1",
            "mavlink: {udp_out: [nowhere]}",
            3,
            "mavlink.udp_out",
            "HOST:PORT with a port in 1..65535",
        ),
        ("seed: 1", "tick_rate_hz: 30", 3, "tick_rate_hz", "(1, 2, 4, 5, 8, 10, 16, 20, 25, ...)"),
        (
            "seed: 1",
            "transmit: {phase_s: 3}",
            3,
            "transmit.phase_s",
            "'drawn' or less than or equal to 1 (got 3)",
        ),
        ("seed: 1", "transmit: null", 3, "transmit", "(got null)"),
        ("wind: calm", "wind: {map: {file: no.nc}}", 8, "wind.map.file", "there is no file"),
        (
            "seed: 1",
            "fdm: {px4: {gps_rate_hz: 7}}",
            3,
            "fdm.px4.gps_rate_hz",
            "divide imu_rate_hz, 250 (got 7)",
        ),
        (
            "  - id: 1",
            "  - id: 1\n    sensor: {band_hz: [2, 1]}",
            15,
            "nodes.1.sensor.band_hz",
            "the lower end comes first",
        ),
        ("  - id: 1", "  - id: 1\n    count: true", 15, "nodes.1.count", "from 0 to 1000 (got true)"),
        (
            "airframe: f450",
            "count: 1\n    airframe: '{30'",
            12,
            "nodes.0.airframe",
            "'{30': expected '}' before end of string; {{ and }} stand for braces",
        ),
        ("seed: 1", "zenoh: maybe", 3, "zenoh", "has to be 'auto' or true or false (got 'maybe')"),
        ("seed: 1", "networks: {main: disk}", 3, "networks.main", "main is the network of the key radio"),
        ("seed: 1", "networks: {a: disk, main: disk}", 3, "networks.main", "choose another name"),
        ("seed: 1", "processes: one\nhosts: 3", 3, "processes", "one, and hosts: 3: choose one of them"),
        (
            "  - id: 1",
            "  - id: 1\n    networks: [main, x]",
            15,
            "nodes.1.networks.1",
            "no network x; there are",
        ),
        ("  - id: 1", "  - id: 1\n    groups: [a, '0']", 15, "nodes.1.groups.1", "0 is the id of a node"),
        (
            "  - id: 1",
            "  - id: 1\n    modems: {other: {}}",
            15,
            "nodes.1.modems.other",
            "node 1 has no radio other; it has: main",
        ),
        (
            "  - id: 1",
            "  - id: 1\n    radio_off:\n      - {from_s: 1}\n      - {from_s: 3}",
            17,
            "nodes.1.radio_off.1.from_s",
            "at or after to_s of the outage before it (got 3)",
        ),
        (
            "wind: calm",
            "wind: {gusts: [{speed_mps: 1, start_s: 0, every_s: 1}]}",
            8,
            "wind.gusts.0.every_s",
            "2 s",
        ),
        (
            "type: delivery, from: 0, to: 1, at_least: 0.9",
            "type: function, function: 'os:getcwd', at_least: 5, at_most: 1",
            22,
            "expectations.0.at_most",
            "1 is below at_least, 5: nothing is both",
        ),
        (
            "type: delivery, from: 0, to: 1, at_least: 0.9",
            "type: function, function: x",
            22,
            "expectations.0.function",
            "has to be FILE.py:NAME or package.module:NAME (got 'x')",
        ),
        (
            "type: delivery, from: 0, to: 1, at_least: 0.9",
            "type: separation, among: [0], at_least_m: 3",
            22,
            "expectations.0.among",
            "has to have at least 2 items, not 1",
        ),
        (
            "type: delivery, from: 0, to: 1, at_least: 0.9",
            "type: separation, among: [0, 1, 0], at_least_m: 3",
            22,
            "expectations.0.among",
            "a node is named twice",
        ),
        ("to: 1", "to: 0", 22, "expectations.0.to", "a node sends nothing to itself"),
        (
            "type: delivery, from: 0, to: 1, at_least: 0.9",
            "type: age, node: 0, from: 0, at_most_s: 1",
            22,
            "expectations.0.from",
            "a node sends nothing to itself",
        ),
        ("to: 1", "between_s: [5]", 22, "expectations.0.between_s.1", "the list has to have more values"),
        ("seed: 1", "autopilot: ardupliot", 3, "autopilot", "did you mean ardupilot?"),
    ],
)
def test_a_wrong_scenario_is_refused(old: str, new: str, line: int, key: str, says: str) -> None:
    assert old in RIGHT
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(RIGHT.replace(old, new, 1), "mine.yaml")
    lines = str(caught.value).splitlines()
    assert lines[0].startswith(f"mine.yaml:{line}: {key}: ")
    assert says in lines[0]
    assert all(re.match(r"mine\.yaml:\d+: ", each) for each in lines)
    assert not any(
        word in str(caught.value)
        for word in ("Input should", "Value error", "pydantic", "valid string", "constrained", "validation")
    )


JAMMER = (
    "  - {id: jam, kind: emitter, place: {north_m: 10}, frequency_hz: 8.6e8, power_dbm: 0}\nexpectations:"
)


@pytest.mark.parametrize(
    ("expectation", "key"),
    [
        ("type: delivery, from: jam, at_least: 0.9", "from"),
        ("type: age, node: jam, at_most_s: 1", "node"),
        ("type: logged, value: x, node: jam, at_least: 1", "node"),
        ("type: separation, among: [0, jam], at_least_m: 1", None),
        ("type: position, node: jam, north_m: 10, east_m: 0, within_m: 1", None),
    ],
)
def test_what_an_emitter_sends_or_hears_is_not_expected_but_where_it_is(
    expectation: str, key: str | None
) -> None:
    text = RIGHT.replace("expectations:", JAMMER).replace(
        "type: delivery, from: 0, to: 1, at_least: 0.9", expectation
    )
    if key is None:
        assert parse_scenario(text, "mine.yaml").expectations
        return
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(text, "mine.yaml")
    said = "jam is an emitter: it exchanges no packets, and has no agent"
    assert str(caught.value) == f"mine.yaml:23: expectations.0.{key}: {said}"


def test_a_frequency_in_megahertz_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"nodes\.2\.frequency_hz|nodes\.jam\.frequency_hz"):
        parse_scenario(RIGHT.replace("expectations:", JAMMER.replace("8.6e8", "860")), "mine.yaml")


def test_what_a_program_asks_for_wrongly_is_told_without_the_validation_s_own_words() -> None:
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(RIGHT, "mine.yaml", overrides={"duration_s": -1})
    assert caught.value.__cause__ is None
    assert caught.value.__suppress_context__


def test_all_mistakes_are_told_at_once() -> None:
    text = (
        RIGHT.replace("seed: 1", "sead: 1")
        .replace("north_m: 5", "north_m: x")
        .replace("altitude_m: 40}", "}")
    )
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(text, "mine.yaml")
    keys = [line.split(": ")[1] for line in str(caught.value).splitlines()]
    assert sorted(keys) == ["nodes.0.agent.altitude_m", "nodes.1.home.north_m", "sead"]


def test_all_mistakes_of_a_radio_are_told_at_once_each_where_it_was_written(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("preset: moon2020\nbandwidth_hz: -1\nnoise: {floor: 3}\n")
    radio = "radio:\n  preset: mine.yaml\n  offset: 3\n  base_loss: 2"
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(RIGHT.replace("radio: moon2020", radio), "here.yaml", tmp_path)
    told = [line.split(": ")[:2] for line in str(caught.value).splitlines()]
    assert sorted(told) == [
        [f"{tmp_path}/mine.yaml:2", "bandwidth_hz"],
        [f"{tmp_path}/mine.yaml:3", "noise.floor"],
        ["here.yaml:10", "radio.base_loss"],
        ["here.yaml:9", "radio.offset"],
    ]


@pytest.mark.parametrize("key", ["nodes.4.home.north_m", "nodes.5.agent.altitude_m", "nodes.5.radio"])
def test_a_mistake_in_a_node_is_told_with_the_key_that_sets_it(key: str) -> None:
    text = (
        RIGHT.replace("id: 1", "id: 5").replace("id: 0", "id: 4").replace("from: 0, to: 1", "from: 4, to: 5")
    )
    with pytest.raises(ScenarioError, match=rf"override {key}='x': {key}: "):
        parse_scenario(text, "mine.yaml", overrides={key: "x"})


def test_the_place_of_a_mistake_in_a_file_that_is_named_comes_first(tmp_path: Path) -> None:
    folder = tmp_path
    (folder / "air.yaml").write_text("constant:\n  speed: 3\n")
    (folder / "mine.yaml").write_text("preset: moon2020\nnoise: {floor: 3}\n")
    (folder / "quad.yaml").write_text("name: quad\n")
    text = RIGHT.replace("wind: calm", "wind: air.yaml").replace("radio: moon2020", "radio: mine.yaml")
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(text.replace("airframe: f450", "airframe: quad.yaml"), "here.yaml", folder)
    told = str(caught.value)
    assert f"{folder}/air.yaml:2: constant.speed: unknown key; did you mean speed_mps?" in told
    assert f"{folder}/mine.yaml:2: noise.floor: unknown key; did you mean floor_dbm?" in told
    assert f"{folder}/quad.yaml:1: vehicle: " in told
    assert all("(named at here.yaml:" in line for line in told.splitlines())
