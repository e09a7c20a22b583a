"""Many nodes written as one."""

from __future__ import annotations

import math
from itertools import combinations
from typing import Any

import pytest

from bridge.scenario.agents import HoldAgent, OwnAgent
from bridge.scenario.document.settings import parse_setting
from bridge.scenario.file import ScenarioError, parse_scenario
from bridge.scenario.model import Scenario

HEAD = """\
schema: 1
name: many
duration_s: 5
seed: 4
origin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600}
radio: moon2020
nodes:
"""
GROUP = "  - {id: 0, count: 6, home: {%s}, agent: {type: still}}\n"


def fleet(nodes: str, *settings: str) -> Scenario:
    return parse_scenario(HEAD + nodes, "many.yaml", overrides=[parse_setting(text) for text in settings])


def homes(pattern: str, *settings: str) -> list[tuple[float, float, float]]:
    return [(u.home.north_m, u.home.east_m, u.home.heading_deg) for u in fleet(GROUP % pattern, *settings).ua]


def test_ids_count_up_and_values_follow_the_index() -> None:
    nodes = """\
  - id: 3
    count: 4
    airframe: {each: [f450, hexa550]}
    home: {north_m: "{10 * i}"}
    agent: {type: hold, altitude_m: "{30 + 5 * (i % 2)}"}
  - id: "mast-{i:02}"
    kind: ground
    count: 2
    place: {line: {spacing_m: 50}, north_m: 7, height_m: 4}
    agent: {type: own, class: "os.path:join", options: {rank: "{n - i}", text: "{{i}} of {n}", list: ["{i}"]}}
"""
    it = fleet(nodes)
    assert [ua.id for ua in it.ua] == [3, 4, 5, 6]
    assert [ua.airframe for ua in it.ua] == ["f450", "hexa550", "f450", "hexa550"]
    assert [ua.home.north_m for ua in it.ua] == [0, 10, 20, 30]
    altitudes = [ua.agent.altitude_m for ua in it.ua if isinstance(ua.agent, HoldAgent)]
    assert altitudes == [30, 35, 30, 35]
    assert [node.id for node in it.ground] == ["mast-00", "mast-01"]
    places = [node.place for node in it.ground]
    assert [(p.north_m, p.east_m, p.height_m) for p in places if p] == [(7, 0, 4), (7, 50, 4)]
    agents = [node.agent for node in it.ground if isinstance(node.agent, OwnAgent)]
    assert [agent.options for agent in agents] == [
        {"rank": 2, "text": "{i} of 2", "list": [0]},
        {"rank": 1, "text": "{i} of 2", "list": [1]},
    ]


def test_what_a_run_keeps_is_expanded_and_reads_back() -> None:
    it = fleet(GROUP % "ring: {radius_m: 30}")
    assert "count" not in it.to_yaml()
    assert parse_scenario(it.to_yaml(), "again") == it


def test_line_column_and_grid() -> None:
    assert homes("line: {spacing_m: 10}, north_m: 5")[:3] == [(5, 0, 0), (5, 10, 0), (5, 20, 0)]
    assert homes("line: {spacing_m: 10, bearing_deg: 180}")[1] == (-10, 0, 0)
    assert homes("column: {spacing_m: 10, heading_deg: 90}")[:3] == [(0, 0, 90), (0, -10, 90), (0, -20, 90)]
    assert homes("grid: {spacing_m: 10}")[3:] == [(10, 0, 0), (10, 10, 0), (10, 20, 0)]
    assert homes("grid: {spacing_m: 10, columns: 2}")[4:] == [(20, 0, 0), (20, 10, 0)]


def test_a_ring_is_even_and_faces_where_it_is_told_to() -> None:
    places = homes("ring: {radius_m: 30, face: inward}, north_m: 100")
    assert places[0] == (130, 0, 180)
    radii = [math.hypot(north - 100, east) for north, east, _ in places]
    assert radii == pytest.approx([30] * 6, abs=1e-3)
    bearings = [math.degrees(math.atan2(east, north - 100)) % 360 for north, east, _ in places]
    assert bearings == pytest.approx([0, 60, 120, 180, 240, 300], abs=1e-2)
    assert [heading for *_, heading in homes("ring: {radius_m: 9}, heading_deg: 7")] == [7] * 6


@pytest.mark.parametrize(
    ("pattern", "wanted"),
    [
        ("ring: {radius_m: 20, face: inward}", [(20, 0), (-20, 0)]),
        ("column: {spacing_m: 10, heading_deg: 90}", [(0, 0), (0, -10)]),
    ],
)
def test_masts_stand_in_patterns_that_have_headings(pattern: str, wanted: list[tuple[int, int]]) -> None:
    node = "  - {id: 'mast-{i}', kind: ground, count: 2, place: {%s}, agent: {type: still}}\n"
    places = [it.place for it in fleet(GROUP % "line: {spacing_m: 9}" + node % pattern).ground]
    assert [(place.north_m, place.east_m) for place in places if place] == wanted


def test_random_places_come_from_the_seed_and_keep_apart() -> None:
    box = "random: {north_m: [0, 100], east_m: [-50, 50], min_spacing_m: 25}"
    places = homes(box)
    assert all(0 <= north <= 100 and -50 <= east <= 50 for north, east, _ in places)
    assert min(math.dist(a[:2], b[:2]) for a, b in combinations(places, 2)) >= 25
    assert homes(box) == places
    assert homes(box, "seed=5") != places
    assert homes(box, "nodes.0.count=3") == places[:3]


def test_settings_of_a_group_and_of_its_nodes() -> None:
    text = GROUP % "ring: {radius_m: 30}"
    it = fleet(text, "nodes.2.home.north_m=1", "nodes.0.count=3", "nodes.0.home.ring.radius_m=50")
    assert [round(ua.home.north_m) for ua in it.ua] == [50, -25, 1]
    assert len(fleet(text + "  - {id: 9, agent: {type: still}}\n", "nodes.0.count=0").ua) == 1
    options = "  - {id: 0, agent: {type: own, class: 'os.path:join', options: {count: 1}}}\n"
    agent: Any = fleet(options, "nodes.0.agent.options.count=7").ua[0].agent
    assert agent.options == {"count": 7}


def test_a_setting_puts_a_group_in_another_pattern() -> None:
    """As a file that extends it does; of a single node a place stays its own."""
    text = GROUP % "column: {spacing_m: 30}"
    it = fleet(text, "nodes.0.home={ring: {radius_m: 50}, north_m: 100}", "nodes.1.home={east_m: 7}")
    assert [(round(ua.home.north_m), round(ua.home.east_m)) for ua in it.ua[:4]] == [
        (150, 0),
        (0, 7),
        (75, 43),
        (50, 0),
    ]
    masts = "  - {id: 'mast-{i}', kind: ground, count: 2, agent: {type: still}}\n"
    it = fleet(text + masts, "nodes.mast-{i}.place={line: {spacing_m: 9}}")
    assert [node.place.east_m for node in it.ground if node.place] == [0, 9]


def test_values_of_a_pattern_follow_count_and_index() -> None:
    """Also the pattern itself may be another node by node; each has the place of its own index in it."""
    by_count = homes("ring: {radius_m: '{10 * n}'}, heading_deg: {each: [1, 2]}", "nodes.0.count=4")
    assert by_count == [(40, 0, 1), (0, 40, 2), (-40, 0, 1), (0, -40, 2)]
    spiral = homes("ring: {radius_m: '{10 + 10 * i}', bearing_deg: {each: [0, 90]}}", "nodes.0.count=4")
    assert spiral == [(10, 0, 0), (-20, 0, 0), (-30, 0, 0), (40, 0, 0)]
    group = "  - {id: 0, count: 4, home: {each: [{line: {spacing_m: 5}}, {column: {spacing_m: 7}}]}, %s}\n"
    two = [(ua.home.north_m, ua.home.east_m) for ua in fleet(group % "agent: {type: still}").ua]
    assert two == [(0, 0), (-7, 0), (0, 10), (-21, 0)]


@pytest.mark.parametrize(
    ("node", "says"),
    [
        (
            "{id: 0, count: 3, home: {ring: {radius_m: '{5 - 5 * i}'}}, agent: {type: still}}",
            "nodes.0.home.ring.radius_m: has to be greater than 0 (got 0)",
        ),
        (
            "{id: 0, count: -1, agent: {type: still}}",
            "nodes.0.count: has to be a number of nodes from 0 to 1000",
        ),
        ("{id: 0, count: x, agent: {type: still}}", "nodes.0.count: has to be a number of nodes"),
        ("{count: 2, agent: {type: still}}", "nodes.0.id: is required, and missing: that of the first node"),
        ("{id: 0, count: [1], agent: {type: still}}", "from 0 to 1000 (got [1])"),
        ("{id: {a: [1]}, count: 2, agent: {type: still}}", "as sensor-{i} (got {'a': [1]})"),
        (
            "{count: 3, home: {ring: {radius_m: 10}}, agent: {type: still}}",
            "nodes.0.id: is required, and missing: that of the first node",
        ),
        (
            "{id: 0, count: 2, home: {ring: {radius_m: 10}, north_m: %s}, agent: {type: still}}"
            % ("9" * 400),
            "nodes.0.home.north_m: has to be",
        ),
        (
            "{id: m, kind: ground, count: 2, agent: {type: still}}",
            "a text with the index, as sensor-{i} (got 'm')",
        ),
        (
            "{id: 0, count: 2, home: {ring: {radius: 3}}, agent: {type: still}}",
            "nodes.0.home.ring.radius: unknown",
        ),
        (
            "{id: 0, count: 2, home: {ring: 3}, agent: {type: still}}",
            "nodes.0.home.ring: has to be a mapping",
        ),
        (
            "{id: 0, count: 2, home: {rnig: {}}, agent: {type: still}}",
            "nodes.0.home.rnig: unknown key; did you mean",
        ),
        (
            "{id: 0, count: 2, home: {ring: {radius_m: 1}, line: {spacing_m: 1}}, agent: {type: still}}",
            "nodes.0.home: line and ring: give one pattern",
        ),
        (
            "{id: 0, home: {ring: {radius_m: 1}}, agent: {type: still}}",
            "nodes.0.home.ring: a pattern needs count",
        ),
        (
            "{id: 0, count: 2, agent: {type: hold, altitude_m: '{30 + j}'}}",
            "nodes.0.agent.altitude_m: {j} cannot be",
        ),
        ("{id: 0, count: 2, agent: {type: hold, altitude_m: '{1 / i}'}}", "{1 / i} cannot be computed"),
        ("{id: 0, count: 2, agent: {type: hold, altitude_m: '{i'}}", "nodes.0.agent.altitude_m: "),
        (
            "{id: 0, count: 2, airframe: '{i:9999999999999}', agent: {}}",
            "{i:9999999999999} cannot be computed",
        ),
        (
            "{id: 0, count: 2, airframe: {each: []}, agent: {type: still}}",
            "nodes.0.airframe.each: has to be a list",
        ),
        (
            "{id: 0, count: 9, home: {random: {north_m: [0, 9], east_m: [0, 9], min_spacing_m: 8}}, agent: {}}",
            "of 9 nodes found room 8 m apart in 9 m x 9 m: make the box larger",
        ),
        (
            "{id: 248, count: 4, agent: {type: still}}",
            "nodes.2.id: has to be less than or equal to 249 (got 250)",
        ),
    ],
)
def test_mistakes_are_told_with_their_line(node: str, says: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        fleet(f"  - {node}\n")
    assert str(caught.value).startswith("many.yaml:8: ")
    assert says in str(caught.value)


def test_a_mistake_in_a_group_is_told_once() -> None:
    with pytest.raises(ScenarioError) as caught:
        fleet("  - {id: 0, count: 9, agent: {type: hold}}\n")
    assert len(str(caught.value).splitlines()) == 1


def test_the_second_of_two_equal_ids_is_named() -> None:
    with pytest.raises(
        ScenarioError, match=r"many.yaml:9: nodes.6.id: id 3 is used more than once, first at many.yaml:8"
    ):
        fleet(GROUP % "line: {spacing_m: 3}" + "  - {id: 3, agent: {type: still}}\n")
    with pytest.raises(
        ScenarioError, match=r"needs its own; what one node of a group has of its own stands in a"
    ):
        fleet(GROUP % "line: {spacing_m: 3}" + "  - {id: 3, radio_off: [{from_s: 1}]}\n")
    with pytest.raises(ScenarioError, match=r"each node needs its own$"):
        fleet("  - {id: 3, agent: {type: still}}\n" * 2)


def test_emitters_stand_in_patterns() -> None:
    emitter = "{id: 'e-{i}', kind: emitter, count: 2, frequency_hz: 2.4e9, power_dbm: 20, place: {%s}}"
    it = fleet(GROUP % "" + "  - " + emitter % "line: {spacing_m: 50}, north_m: 7" + "\n")
    places = [node.place for node in it.emitters]
    assert [(p.north_m, p.east_m, p.height_m) for p in places if p] == [(7, 0, 2), (7, 50, 2)]
