"""Nodes are spread over host processes."""

from __future__ import annotations

import pytest

from bridge.fleet.hosts import host_groups, standin_groups
from bridge.scenario.file import SCENARIOS, ScenarioError, parse_scenario
from fdm.exchange.settings import core_count

TEXT = (SCENARIOS / "separation.yaml").read_text(encoding="utf-8")
MORE = "".join(f"  - {{id: {n}, agent: {{type: still}}}}\n" for n in range(2, 7))


@pytest.mark.parametrize(
    ("hosts", "sizes"),
    [("1", [7]), ("2", [4, 3]), ("3", [3, 2, 2]), ("9", [1] * 7), ("per-ua", [1] * 7)],
)
def test_nodes_are_spread_evenly(hosts: str, sizes: list[int]) -> None:
    scenario = parse_scenario(f"{TEXT}{MORE}hosts: {hosts}\n", "my.yaml")
    groups = host_groups(scenario)
    assert [len(group) for group in groups.values()] == sizes
    assert sorted(node for group in groups.values() for node in group) == sorted(scenario.regulated)
    assert list(groups) == [f"host-{number}" for number in range(len(sizes))]
    assert standin_groups(scenario) == tuple(groups.values())


def test_an_isolated_agent_has_a_host_of_its_own_and_a_free_one_none() -> None:
    more = "  - {id: 8, agent: {type: still, isolated: true}}\n  - {id: gcs, kind: ground, agent: {type: free}}\n"
    groups = host_groups(parse_scenario(f"{TEXT}{more}hosts: 1\n", "my.yaml"))
    assert groups == {"host-0": ("0", "1"), "host-of-8": ("8",)}


def test_auto_is_a_host_per_core_at_most() -> None:
    scenario = parse_scenario(f"{TEXT}{MORE}", "my.yaml")
    assert len(host_groups(scenario)) == min(7, core_count())
    assert len(standin_groups(scenario)) == max(1, min(7, core_count() // 2))


@pytest.mark.parametrize("hosts", ["0", "-1", "many", "1.5", "true"])
def test_other_words_are_refused(hosts: str) -> None:
    with pytest.raises(ScenarioError, match="has to be 'auto', 'per-ua' or a number"):
        parse_scenario(f"{TEXT}hosts: {hosts}\n", "my.yaml")


@pytest.mark.parametrize("rate_hz", ["30", "10", "140"])
def test_mavlink_is_exchanged_at_a_multiple_of_the_ticks(rate_hz: str) -> None:
    with pytest.raises(ScenarioError, match="multiple of tick_rate_hz"):
        parse_scenario(f"{TEXT}mavlink_rate_hz: {rate_hz}\n", "my.yaml")
