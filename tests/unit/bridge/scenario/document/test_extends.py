"""One scenario on top of another."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import pytest

from bridge.scenario.agents import HoldAgent, OutAndBackAgent, StillAgent
from bridge.scenario.document.merge import NULL_IS_A_VALUE
from bridge.scenario.file import ScenarioError, read_scenario
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.flight import wind_of
from bridge.scenario.schema.transform import all_models
from channel.config import RadioConfig
from fdm.air.wind import WindConfig

BASE = """\
schema: 1
name: base
duration_s: 5
origin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600}
radio: {preset: moon2020, noise: {floor_dbm: -90}, base_loss: 0.1}
wind: air.yaml
ports: {first_slot: 3, zenoh: 0}
mavlink: {udp_out: ["127.0.0.1:1", "127.0.0.1:2"]}
nodes:
  - {id: 0, home: {north_m: 5, east_m: 6}, agent: {type: hold, altitude_m: 40}}
  - {id: 1, agent: {type: out_and_back, altitude_m: 40, distance_m: 60}}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "bases").mkdir()
    (tmp_path / "bases" / "base.yaml").write_text(BASE)
    (tmp_path / "bases" / "air.yaml").write_text("constant: {speed_mps: 3}\n")
    return tmp_path


def mine(folder: Path, text: str) -> Path:
    (folder / "mine.yaml").write_text(f"extends: bases/base.yaml\n{text}")
    return folder / "mine.yaml"


def test_mappings_are_merged_lists_replaced_and_nodes_merged_by_id(folder: Path) -> None:
    text = """\
name: mine
ports: {zenoh: 7}
mavlink: {udp_out: []}
nodes:
  - {id: 2, agent: {type: still}}
  - {id: 0, home: {north_m: 50}}
"""
    it = read_scenario(mine(folder, text))
    assert (it.name, it.duration_s, it.ports.first_slot, it.ports.zenoh) == ("mine", 5.0, 3, 7)
    assert it.mavlink.udp_out == ()
    assert [(ua.id, ua.home.north_m, ua.home.east_m) for ua in it.ua] == [(0, 50, 6), (1, 0, 0), (2, 0, 0)]


def test_another_type_or_preset_takes_nothing_from_what_is_extended(folder: Path) -> None:
    it = read_scenario(mine(folder, "radio: {preset: disk}\nnodes: [{id: 1, agent: {type: still}}]\n"))
    assert it.radio == {"preset": "disk"}
    assert it.ua[1].agent == StillAgent(type="still")
    it = read_scenario(
        mine(folder, "radio: {noise: {floor_dbm: -80}}\nnodes: [{id: 0, agent: {altitude_m: 9}}]\n")
    )
    assert it.radio == {"preset": "moon2020", "noise": {"floor_dbm": -80}, "base_loss": 0.1}
    assert it.ua[0].agent == HoldAgent(type="hold", altitude_m=9)


def test_nodes_can_be_left_out(folder: Path) -> None:
    it = read_scenario(mine(folder, "without: [0]\nnodes: [{id: 7, agent: {type: still}}]\n"))
    assert [ua.id for ua in it.ua] == [1, 7]


def test_files_are_seen_from_whoever_names_them(folder: Path) -> None:
    it = read_scenario(mine(folder, ""))
    assert it.wind == str(folder / "bases" / "air.yaml")
    assert wind_of(it).constant is not None


def test_files_in_options_are_seen_from_whoever_names_them(folder: Path) -> None:
    options = "options: {file: a.npz, deep: {weights_file: b.npz, name: c.npz}}"
    (folder / "own.py").write_text(
        "from lostlink import Agent\n"
        "class Own(Agent):\n    reads = 'file', 'deep', 'other_file'\n"
        "def fast(run, table_file): ...\n"
    )
    (folder / "bases" / "base.yaml").write_text(
        BASE.replace("type: hold, altitude_m: 40", f"type: own, class: ../own.py:Own, {options}")
    )
    text = "expectations: [{type: function, function: own.py:fast, options: {table_file: t.csv}}]\n"
    it = read_scenario(mine(folder, text), {"nodes.0.agent.options.other_file": "~/d.npz"})
    deep = {"weights_file": str(folder / "bases" / "b.npz"), "name": "c.npz"}
    assert it.ua[0].agent.options == {
        "file": str(folder / "bases" / "a.npz"),
        "deep": deep,
        "other_file": str(Path("~/d.npz").expanduser()),
    }
    assert it.expectations[0].options == {"table_file": str(folder / "t.csv")}


def test_an_option_without_a_file_stays_empty(folder: Path) -> None:
    """It was the folder of the scenario, which agents took for a file that is there."""
    (folder / "own.py").write_text(
        "from lostlink import Agent\nclass Own(Agent):\n    reads = 'weights_file', 'file'\n"
    )
    own = "type: own, class: ../own.py:Own, options: {weights_file: '', file: null}"
    (folder / "bases" / "base.yaml").write_text(BASE.replace("type: hold, altitude_m: 40", own))
    assert read_scenario(mine(folder, "")).ua[0].agent.options == {"weights_file": "", "file": None}


def test_a_shipped_scenario_and_a_chain_can_be_extended(folder: Path) -> None:
    (folder / "one.yaml").write_text("extends: separation\nname: one\nseed: 5\n")
    (folder / "two.yaml").write_text("extends: one.yaml\nname: two\n")
    it = read_scenario(folder / "two.yaml")
    assert (it.name, it.seed) == ("two", 5)
    assert it.model_copy(update={"name": "separation", "seed": 1}) == read_scenario("separation").model_copy()
    assert isinstance(it.ua[1].agent, OutAndBackAgent)


def test_a_mistake_is_told_where_it_was_written(folder: Path) -> None:
    base = folder / "bases" / "base.yaml"
    base.write_text(BASE.replace("north_m: 5", "nort_m: 5"))
    with pytest.raises(ScenarioError) as caught:
        read_scenario(mine(folder, "name: mine\nsead: 4\n"))
    lines = str(caught.value).splitlines()
    assert f"{folder}/mine.yaml:3: sead: unknown key; did you mean seed?" in lines[0] + lines[1]
    assert f"{base}:10: nodes.0.home.nort_m: unknown key; did you mean north_m?" in lines[0] + lines[1]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            "extends: mine.yaml\n",
            r"mine.yaml:1: extends: mine.yaml -> mine.yaml: a scenario cannot extend itself",
        ),
        (
            "extends: seperation\n",
            r"mine.yaml:1: extends: no scenario 'seperation'; did you mean separation\?",
        ),
        ("\nextends: nothing.yaml\n", r"mine.yaml:2: extends: there is no file .*nothing.yaml"),
        (
            "extends: [a]\n",
            r"mine.yaml:1: extends: has to be the name of a scenario that ships, or a file \(got \['a'\]\)",
        ),
        (
            "extends: /nothing\n",
            r"extends: no scenario '/nothing' \(has to be a file that ends in .yaml or .yml",
        ),
        ("extends: separation\nwithout: [[9]]\n", r"no node of what is extended has id \[9\]$"),
        (
            "extends: separation\nwithout: [9]\n",
            r"mine.yaml:2: without: no node of what is extended has id 9",
        ),
        ("extends: separation\nwithout: 1\n", r"mine.yaml:2: without: has to be a list of ids"),
        ("without: [1]\n", r"mine.yaml:1: without: .* but there is no extends"),
        ("extends: broken.yaml\n", r"broken.yaml:2: is not YAML"),
    ],
)
def test_what_cannot_be_extended_is_refused(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "mine.yaml").write_text(text)
    (tmp_path / "broken.yaml").write_text("a: [\nb: }")
    with pytest.raises(ScenarioError, match=says):
        read_scenario(tmp_path / "mine.yaml")


def test_a_cycle_of_two_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("extends: b.yaml\n")
    (tmp_path / "b.yaml").write_text("extends: a.yaml\n")
    with pytest.raises(ScenarioError, match=r"b.yaml:1: extends: a.yaml -> b.yaml -> a.yaml"):
        read_scenario(tmp_path / "a.yaml")


def test_null_removes_a_key_whatever_the_model_says_of_it(folder: Path) -> None:
    text = """\
wind: null
ports: {first_slot: null}
radio: {noise: null, base_loss: null}
nodes: [{id: 0, home: {north_m: null}, agent: {type: still, altitude_m: null}}]
"""
    it = read_scenario(mine(folder, text))
    assert (it.wind, it.ports.first_slot, it.ports.zenoh) == ("calm", 0, 0)
    assert it.radio == {"preset": "moon2020"}
    assert (it.ua[0].home.north_m, it.ua[0].home.east_m) == (0.0, 6.0)
    assert it.ua[0].agent == StillAgent(type="still")


def test_null_removes_the_count_and_the_pattern_of_a_group(folder: Path) -> None:
    group = "  - {id: 3, count: 4, home: {north_m: 9, line: {spacing_m: 5}}, agent: {type: still}}\n"
    (folder / "bases" / "base.yaml").write_text(BASE + group)
    it = read_scenario(mine(folder, "nodes: [{id: 3, count: null, home: {line: null}}]\n"))
    assert [ua.id for ua in it.ua] == [0, 1, 3]
    assert it.node("3") == it.ua[2]
    assert it.ua[2].home.north_m == 9.0


GROUPS = """\
  - {id: 3, count: 3, home: {north_m: 9, line: {spacing_m: 5}}, agent: {type: hold, altitude_m: "{40 + i}"}}
  - {id: "mast-{i}", kind: ground, count: 2, agent: {type: still}}
"""


@pytest.fixture
def grouped(folder: Path) -> Path:
    (folder / "bases" / "base.yaml").write_text(BASE + GROUPS)
    return folder


def off(it: Scenario) -> list[str]:
    return [str(node.id) for node in it.transceivers if node.radio_off]


@pytest.mark.parametrize("node", ["3", "4", "mast-1"])
def test_an_id_within_a_group_is_that_node_alone_as_with_set(grouped: Path, node: str) -> None:
    over = mine(grouped, f"nodes: [{{id: {node}, radio_off: [{{from_s: 3}}]}}]\n")
    it = read_scenario(over)
    assert off(it) == [node]
    base = grouped / "bases" / "base.yaml"
    said = read_scenario(base, {f"nodes.{node}.radio_off": [{"from_s": 3}]})
    assert it.nodes == said.nodes


@pytest.mark.parametrize(
    ("entry", "whole"),
    [
        ("{id: 3, count: 3, radio_off: [{from_s: 3}]}", ["3", "4", "5"]),
        ("{id: 3, home: {line: {spacing_m: 7}}, radio_off: [{from_s: 3}]}", ["3", "4", "5"]),
        ("{id: 'mast-{i}', radio_off: [{from_s: 3}]}", ["mast-0", "mast-1"]),
    ],
)
def test_a_count_a_pattern_or_the_index_is_of_the_whole_group(
    grouped: Path, entry: str, whole: list[str]
) -> None:
    assert off(read_scenario(mine(grouped, f"nodes: [{entry}]\n"))) == whole


def test_a_node_of_a_group_is_changed_by_one_file_after_the_other(grouped: Path) -> None:
    mine(grouped, "nodes: [{id: 4, radio_off: [{from_s: 3}], agent: {type: still}}]\n")
    last = grouped / "last.yaml"
    last.write_text(
        "extends: mine.yaml\nnodes: [{id: 4, radio_off: null, home: {east_m: 2}}]\nwithout: [3, mast-0]\n"
    )
    it = read_scenario(last, {"nodes.3.count": 4})
    assert [str(node.id) for node in it.transceivers] == ["0", "1", "4", "5", "6", "mast-1"]
    assert it.ua[2].agent == StillAgent(type="still")
    assert (it.ua[2].home.north_m, it.ua[2].home.east_m) == (9.0, 2.0)
    assert off(it) == []
    with pytest.raises(
        ScenarioError, match=r"mine.yaml:2: nodes.4: .* has no such node any more; it has: 3$"
    ):
        read_scenario(grouped / "mine.yaml", {"nodes.3.count": 1})


@pytest.mark.parametrize("node", ["3", "4", "mast-0"])
def test_a_node_of_a_group_that_is_left_out_is_there_no_more(grouped: Path, node: str) -> None:
    kind, still = "ground" if node == "mast-0" else "ua", "agent: {type: still}"
    anew = f"nodes: [{{id: {node}, kind: {kind}, {still}, radio_off: [{{from_s: 3}}]}}]\n"
    over = mine(grouped, f"without: [{node}]\n{anew}")
    ids = [str(each.id) for each in read_scenario(over).transceivers]
    assert sorted(ids) == ["0", "1", "3", "4", "5", "mast-0", "mast-1"]
    assert off(read_scenario(over)) == [node]
    mine(grouped, f"without: [{node}]\n")
    last = grouped / "last.yaml"
    last.write_text(f"extends: mine.yaml\n{anew}")
    assert off(read_scenario(last)) == [node]
    last.write_text(f"extends: mine.yaml\nwithout: [{node}]\n")
    with pytest.raises(
        ScenarioError, match=rf"last.yaml:2: without: no node of what is extended has id '?{node}'?$"
    ):
        read_scenario(last)


def test_a_mistake_in_a_node_of_a_group_is_told_where_it_is_written(grouped: Path) -> None:
    with pytest.raises(ScenarioError, match=r"mine.yaml:2: nodes.4.radio_of: unknown key") as told:
        read_scenario(mine(grouped, "nodes: [{id: 4, radio_of: []}]\n"))
    assert len(str(told.value).splitlines()) == 1


def test_null_with_nothing_below_is_a_value(folder: Path) -> None:
    assert read_scenario(mine(folder, "radio: {max_range_m: null}\n")).radio["max_range_m"] is None
    with pytest.raises(ScenarioError, match=r"mine.yaml:2: transmit: has to be a mapping"):
        read_scenario(mine(folder, "transmit: null\n"))


def test_null_stays_where_a_radio_means_something_by_it(folder: Path) -> None:
    (folder / "bases" / "base.yaml").write_text(BASE.replace("base_loss: 0.1", "earth_radius_factor: 1"))
    it = read_scenario(mine(folder, "radio: {earth_radius_factor: null}\n"))
    assert it.radio["earth_radius_factor"] is None


def test_no_other_key_means_something_else_by_null_than_by_being_left_out() -> None:
    found = {
        key
        for model in (Scenario, RadioConfig, WindConfig)
        for part in all_models(model)
        for key, field in part.model_fields.items()
        if type(None) in get_args(field.annotation)
        and field.get_default(call_default_factory=True) is not None
    }
    assert found == NULL_IS_A_VALUE
