"""Nodes are spread over host processes."""

from __future__ import annotations

import pytest

from bridge.fleet.hosts import host_groups, host_of, standin_groups
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
    assert [len(group) for group in groups] == sizes
    assert sorted(node for group in groups for node in group) == sorted(scenario.nodes)
    for number, group in enumerate(groups):
        assert {host_of(scenario, node) for node in group} == {f"host-{number}"}
    assert standin_groups(scenario) == groups


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
