"""Radio networks of a scenario: who is on which, and what is wrong with them."""

from __future__ import annotations

from pathlib import Path

import pytest

from bridge.record.inputs.radio_switches import switches_of
from bridge.scenario.file import ScenarioError, parse_scenario
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.channel import channel_of
from bridge.scenario.resolve.radio import common_radio

HEAD = "schema: 1\nname: made\nduration_s: 1\norigin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600.0}\n"
NODES = """nodes:
  - {id: 0, agent: {type: still}}
  - {id: 1, networks: [main, mesh], agent: {type: still}}
  - {id: gcs, kind: ground, networks: [main], agent: {type: still}, radio_off: [{from_s: 0.5}]}
  - {id: mast, kind: ground, agent: {type: still}, radio_off: [{from_s: 0.2}]}
"""
RADIOS = "radio: telemetry-915\nnetworks: {mesh: wifi-2.4}\n"


def parsed(radios: str = RADIOS, nodes: str = NODES) -> Scenario:
    return parse_scenario(HEAD + radios + nodes, "made.yaml", Path("/somewhere"))


def test_nodes_are_on_all_networks_unless_they_say_which() -> None:
    scenario = parsed()
    assert scenario.network_names == ("main", "mesh")
    assert [node.node for node in scenario.nodes_on("mesh")] == ["0", "1", "mast"]
    assert scenario.reach_of("gcs") == {"main": ("0", "1", "gcs", "mast")}
    assert scenario.reach_of("1")["mesh"] == ("0", "1", "mast")
    assert Scenario.from_yaml(scenario.to_yaml()) == scenario


def test_each_network_has_the_radio_and_the_switches_of_its_nodes() -> None:
    scenario = parsed()
    channels = [
        channel_of(scenario, switches_of(scenario, network=name), name) for name in scenario.network_names
    ]
    assert [channel.medium.nodes for channel in channels] == [("0", "1", "gcs", "mast"), ("0", "1", "mast")]
    assert [{r.config.frequency_hz // 1e6 for r in each.medium.radios} for each in channels] == [
        {915.0},
        {2437.0},
    ]
    off = [channel.medium.radios_off(600_000_000).tolist() for channel in channels]
    assert off == [[False, False, True, True], [False, False, True]]
    assert common_radio(scenario) is None


@pytest.mark.parametrize(
    ("radios", "nodes", "text"),
    [
        (
            "radio: perfect\nnetworks: {main: wifi-2.4}\n",
            NODES,
            "networks.main: main is the network of the key radio",
        ),
        ("radio: perfect\nnetworks: {all: wifi-2.4}\n", NODES, "networks.all: all is the address of packets"),
        (
            "radio: perfect\nnetworks: {mash: wifi-2.4}\n",
            NODES,
            "nodes.1.networks.1: no network mesh; there are: main, mash",
        ),
        ("radio: perfect\n", NODES, "nodes.1.networks.1: no network mesh; there are: main"),
        (RADIOS, NODES.replace("[main]", "[]"), "all nodes are on main: name it, too"),
        (RADIOS, NODES.replace("[main, mesh]", "[mesh]"), "all nodes are on main: name it, too"),
        (
            RADIOS,
            NODES.replace("[main, mesh]", "[main]").replace("{id: 0,", "{id: 0, networks: [main],"),
            "networks.mesh: fewer than two nodes are on it",
        ),
        ("radio: perfect\nnetworks: {mesh: wify-2.4}\n", NODES, "networks.mesh: "),
        ("radio: perfect\nnetworks: {mesh: {preset: wifi-2.4, mtu: 5}}\n", NODES, "networks.mesh.mtu"),
        ("radio: perfect\nnetworks: {mesh/2: wifi-2.4}\n", NODES, "mesh/2"),
    ],
)
def test_mistakes_are_told_where_they_are(radios: str, nodes: str, text: str) -> None:
    with pytest.raises(ScenarioError, match=r"made\.yaml") as error:
        parsed(radios, nodes)
    assert text in str(error.value)


def test_files_of_a_networks_radio_are_seen_from_the_scenario(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("preset: perfect\nmtu_bytes: 77\n")
    text = HEAD + "radio: perfect\nnetworks: {mesh: mine.yaml}\n" + NODES
    scenario = parse_scenario(text, "made.yaml", tmp_path)
    assert scenario.networks == {"mesh": str(tmp_path / "mine.yaml")}
    [mtu_bytes] = {
        r.config.mtu_bytes
        for r in channel_of(scenario, switches_of(scenario, network="mesh"), "mesh").medium.radios
    }
    assert mtu_bytes == 77
