"""What `lostlink check` says of who hears whom, and of modems."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from bridge.scenario.file import ScenarioError, parse_scenario
from lostlink.cli.flying.check import check
from lostlink.plan.output import lines_of
from lostlink.plan.plan import RunPlan, plan_of

TEXT = """\
schema: 1
name: linked
duration_s: 60
origin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600}
radio: RADIO
networks: {telemetry: NETWORK}
nodes:
  - {id: 0, count: 3, home: {line: {spacing_m: 10}}, modems: {telemetry: {}}, agent: {type: still}}
  - {id: gcs, kind: ground, modems: {telemetry: {}}, agent: {type: still}}
"""


def sik(units: str) -> str:
    return f"{{preset: sik-433, medium: {{{units}}}}}"


def planned(network: str, radio: str = "perfect") -> RunPlan:
    text = TEXT.replace("NETWORK", network).replace("RADIO", radio)
    return plan_of(parse_scenario(text, "linked.yaml", Path("/somewhere")))


@pytest.mark.parametrize(
    ("network", "links", "without"),
    [
        (sik("units: {42: [gcs, 0, 1, 2]}"), {"NETID 42": ("gcs", "0", "1", "2")}, []),
        (
            sik("units: {7: [gcs, 0], 8: [1, '2']}"),
            {"NETID 7": ("gcs", "0"), "NETID 8": ("1", "2")},
            ["1", "2"],
        ),
        (sik("units: {7: [gcs, 0, 1]}"), {"NETID 7": ("gcs", "0", "1")}, ["2"]),
        (sik('pairs: [["0", gcs]], netids: [9]'), {"NETID 9": ("0", "gcs")}, ["1", "2"]),
        ("sik-433", {"NETID 25": ("0", "1"), "NETID 26": ("2", "gcs")}, ["0", "1"]),
        (
            "elrs-900-200",
            {"pair 1": ("0", "1"), "pair 2": ("2", "gcs")},
            ["0", "1"],
        ),
    ],
)
def test_who_hears_whom_and_which_modems_have_no_ground_station(
    network: str, links: dict[str, tuple[str, ...]], without: list[str]
) -> None:
    plan = planned(network)
    assert [(each.network, dict(each.nodes)) for each in plan.links] == [("telemetry", links)]
    warned = [line for line in plan.warnings if "no link with a ground station" in line]
    assert [line.split(":")[0] for line in warned] == [f"node {node}" for node in without]
    told = list(lines_of(plan))
    assert "Who hears whom" in told
    assert ("(more than two: they disturb each other)" in "\n".join(told)) == (
        max(map(len, links.values())) > 2
    )


def test_radios_on_which_all_hear_each_other_have_no_links() -> None:
    assert planned("xbee-900hp").links == ()


def test_packets_for_all_come_to_those_of_the_netid_alone() -> None:
    (warning,) = [line for line in planned("xbee-900hp", "telemetry-915").warnings if "no_peer" in line]
    assert warning.startswith("radio main: what a node sends to all")
    assert "NETID 25: 0, 1; NETID 26: 2, gcs" in warning
    one = "{preset: telemetry-915, medium: {units: {25: [0, 1, 2, gcs]}}}"
    assert not [line for line in planned("xbee-900hp", one).warnings if "no_peer" in line]


@pytest.mark.parametrize(
    ("units", "text"),
    [
        ("units: {25: [gcs, 0, 1], 26: [1, 2]}", "units: node 1 is twice on NETID 25 and 26"),
        ("units: {25: [gcs, 0, 0]}", "units: node 0 is twice on NETID 25"),
        ("units: {25: [gcs]}", "units: NETID 25 has 1 of 2 or more nodes"),
        ("units: {25: [gcs, 9]}", "node 9 is not there; there are 0, 1, 2, gcs"),
        ("units: {here: [gcs, 0]}", "units.here"),
        ("units: {70000: [gcs, 0]}", "less than or equal to 65535"),
        ("units: {25: [gcs, 0]}, netids: [3]", "leave pairs and netids out"),
    ],
)
def test_units_that_cannot_be_are_refused(units: str, text: str) -> None:
    with pytest.raises(ScenarioError, match=text) as caught:
        planned(sik(units))
    assert "linked.yaml:6: networks.telemetry.medium" in str(caught.value)


@pytest.mark.parametrize(
    ("baud", "rate_hz", "is_told"), [(460_800, 20, True), (57_600, 20, False), (460_800, 100, True)]
)
def test_a_line_that_fills_the_buffer_before_the_autopilot_hears_of_it(
    baud: int, rate_hz: int, is_told: bool
) -> None:
    """30 % of 460800 baud in three ticks of 50 ms are 2074 B, more than a third of ExpressLRS's 1024."""
    text = TEXT.replace("RADIO", "perfect").replace(
        "modems: {telemetry: {}}, agent", f"modems: {{telemetry: {{baud: {baud}}}}}, agent"
    )
    text = text.replace("NETWORK", "elrs-900-200") + f"tick_rate_hz: {rate_hz}\n"
    plan = plan_of(parse_scenario(text, "linked.yaml", Path("/somewhere")))
    warned = [line for line in plan.warnings if "RADIO_STATUS" in line]
    assert bool(warned) == is_told
    if rate_hz == 20 and is_told:
        assert len(warned) == 3
        assert "150 ms late, and writes 2074 bytes" in warned[0]


def test_as_json(tmp_path: Path) -> None:
    file = tmp_path / "linked.yaml"
    file.write_text(TEXT.replace("RADIO", "perfect").replace("NETWORK", sik("units: {25: [gcs, 0, 1, 2]}")))
    plan = json.loads(CliRunner().invoke(check, [str(file), "--json"]).output)
    assert plan["links"] == [
        {
            "network": "telemetry",
            "radio": "sik-433",
            "nodes": {"NETID 25": ["gcs", "0", "1", "2"]},
            "alone": [],
        }
    ]


def test_a_node_beside_a_pair_with_modems_is_told_that_it_has_no_link() -> None:
    text = (
        TEXT.replace("networks: {telemetry: NETWORK}\n", "")
        .replace("RADIO", "sik-433")
        .replace("count: 3", "count: 2")
    )
    nodes = text.replace("modems: {telemetry: {}}, ", "").replace(
        "kind: ground,", "kind: ground, modems: {main: {}},"
    )
    nodes += "  - {id: 7, modems: {main: {}}, agent: {type: still}}\n"
    nodes = nodes.replace("radio: sik-433", 'radio: {preset: sik-433, medium: {pairs: [[gcs, "7"]]}}')
    warnings = plan_of(parse_scenario(nodes, "beside.yaml", Path("/somewhere"))).warnings
    assert [line.split(":")[0] for line in warnings if "no link with it" in line] == ["node 0", "node 1"]
