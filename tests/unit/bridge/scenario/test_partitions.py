"""Partitions as scenarios write them: who is apart from whom, and mistakes."""

from __future__ import annotations

import pytest

from bridge.scenario.file import parse_scenario
from bridge.scenario.mistakes.error import ScenarioError
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.partitions import partitions_of
from channel.medium.stations.partitions import Partition

TEXT = """schema: 1
name: parted
duration_s: 50
origin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600}
radio: moon2020
nodes:
  - {id: 0, count: 4, groups: ["side-{i %% 2}"], agent: {type: still}}
  - {id: gcs, kind: ground, groups: [side-0], agent: {type: still}}
  - {id: jam, kind: emitter, frequency_hz: 2.4e+9, power_dbm: 3}
partitions: %s
"""


def scenario(partitions: str) -> Scenario:
    return parse_scenario(TEXT % partitions, "parted.yaml")


def test_groups_list_nodes_and_groups_of_addressees() -> None:
    it = scenario(
        "[{groups: [[side-0], [1, '3']], from_s: 2.5, to_s: 3}, {groups: [[0, 0], [gcs]], from_s: 0}]"
    )
    assert partitions_of(it) == [
        Partition((("0", "2", "gcs"), ("1", "3")), 2_500_000_000, 3_000_000_000),
        Partition((("0",), ("gcs",)), 0, None),
    ]
    assert Scenario.from_yaml(it.to_yaml()) == it
    assert partitions_of(scenario("[]")) == []


@pytest.mark.parametrize(
    ("partition", "key", "says"),
    [
        ("{groups: [[0], [9]], from_s: 1}", "0.groups.1.0", "no node 9 that exchanges packets"),
        ("{groups: [[0], [jam]], from_s: 1}", "0.groups.1.0", "there are: 0, 1, 2, 3, gcs, side-0, side-1"),
        ("{groups: [[0, 1], [2, 1]], from_s: 1}", "0.groups.1.1", "node 1 is in group 0, too"),
        ("{groups: [[side-0], [1, gcs]], from_s: 1}", "0.groups.1.1", "node gcs is in group 0, too"),
        ("{groups: [[0, 1]], from_s: 1}", "0.groups", "at least 2"),
        ("{groups: [[0], []], from_s: 1}", "0.groups.1", "at least 1"),
        ("{groups: [[0], [1]]}", "0.from_s", "is required"),
        ("{groups: [[0], [1]], from_s: 3, to_s: 3}", "0.to_s", "has to be above from_s, 3 (got 3)"),
        ("{groups: [[0], [1]], from_s: -1}", "0.from_s", "greater than or equal to 0"),
        ("{groups: [[0], [1]], from_s: 1, until_s: 3}", "0.until_s", "unknown key"),
    ],
)
def test_mistakes_are_told_with_their_place(partition: str, key: str, says: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario(f"[{partition}]")
    text = str(caught.value)
    assert f"partitions.{key}" in text
    assert says in text
    assert text.startswith("parted.yaml:10: ")
