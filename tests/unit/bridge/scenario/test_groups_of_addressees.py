"""Groups of nodes that packets may be for, in a scenario."""

from __future__ import annotations

from pathlib import Path

import pytest

from bridge.record.inputs.radio_switches import switches_of
from bridge.scenario.file import ScenarioError, parse_scenario
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.channel import channel_of

HEAD = """schema: 1
name: made
duration_s: 1
origin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600.0}
radio: telemetry-915
networks: {mesh: wifi-2.4}
"""
NODES = """nodes:
  - {id: 0, count: 4, groups: ["squad-{i % 2}", fleet], agent: {type: still}}
  - {id: gcs, kind: ground, networks: [main], groups: [ears], agent: {type: still}}
  - {id: mast, kind: ground, agent: {type: still}}
"""


def parsed(nodes: str = NODES) -> Scenario:
    return parse_scenario(HEAD + nodes, "made.yaml", Path("/somewhere"))


def test_nodes_are_in_the_groups_that_they_say_on_the_networks_that_they_are_on() -> None:
    scenario = parsed()
    assert scenario.groups == ("ears", "fleet", "squad-0", "squad-1")
    fleet = ("0", "1", "2", "3")
    squads = {"squad-0": ("0", "2"), "squad-1": ("1", "3")}
    assert scenario.groups_on("main") == {"ears": ("gcs",), "fleet": fleet, **squads}
    assert scenario.groups_on("mesh") == {"ears": (), "fleet": fleet, **squads}
    assert scenario.reach_of("mast") == {
        "main": (*fleet, "gcs", "mast", "ears", "fleet", "squad-0", "squad-1"),
        "mesh": (*fleet, "mast", "fleet", "squad-0", "squad-1"),
    }
    assert Scenario.from_yaml(scenario.to_yaml()) == scenario
    codes = [
        channel_of(scenario, switches_of(scenario, network=name), name).medium.addressees.codes["squad-1"]
        for name in scenario.network_names
    ]
    assert codes == [-5, -5]  # the same on all networks: below -1, which is everybody, in the order of names


@pytest.mark.parametrize(
    ("group", "text"),
    [
        ("gcs", "nodes.0.groups.1: gcs is the id of a node"),
        ("all", "nodes.0.groups.1: all is the address of packets for every node"),
        ("a/b", "a/b"),
    ],
)
def test_a_group_has_a_name_of_its_own(group: str, text: str) -> None:
    with pytest.raises(ScenarioError, match=r"made\.yaml") as error:
        parsed(NODES.replace("fleet", group))
    assert text in str(error.value)


def test_emitters_are_in_no_group() -> None:
    jammer = "  - {id: j, kind: emitter, groups: [fleet], frequency_hz: 1e9, power_dbm: 1}\n"
    with pytest.raises(ScenarioError, match="groups"):
        parsed(NODES + jammer)
