"""Modems of a scenario: where they may be, and what is wrong with those that may not."""

from __future__ import annotations

from pathlib import Path

import pytest

from bridge.program.standins import serials_of, standin_options
from bridge.scenario.file import ScenarioError, parse_scenario
from bridge.scenario.model import Scenario
from bridge.scenario.modems import UaModem, addressee_of

HEAD = """schema: 1
name: made
duration_s: 1
origin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600.0}
radio: perfect
networks: {near: sik-433, far: {preset: elrs-900-200, medium: {pairs: [[gcs, "0"]]}}}
nodes:
"""
UA = "  - {id: 0, modems: {MODEMS}, agent: {type: still}}\n"
GCS = "  - {id: gcs, kind: ground, modems: {MODEMS}, agent: {type: AGENT}}\n"


def parsed(ua: str = "", ground: str = "", agent: str = "still") -> Scenario:
    nodes = UA.replace("MODEMS", ua) + GCS.replace("MODEMS", ground).replace("AGENT", agent)
    return parse_scenario(HEAD + nodes, "made.yaml", Path("/somewhere"))


def test_a_modem_is_at_a_serial_port_and_its_line_as_fast_as_its_firmware_has_it() -> None:
    scenario = parsed("near: {}, far: {serial: 2, baud: 115200}", "near: {}, far: {serve: [pty]}")
    (ua,) = scenario.ua
    assert list(scenario.modems_on("near")) == ["0", "gcs"]
    assert scenario.modems_on("main") == {}
    assert serials_of(scenario, ua) == [(1, 5762, 57_600), (2, 5763, 115_200)]
    options = standin_options(scenario, ua)
    assert [options[place + 1] for place, word in enumerate(options) if word == "--serial"] == [
        "1:5762:57600",
        "2:5763:115200",
    ]
    assert scenario.ground[0].modems["near"].serve == ("tcpin::5790",)
    assert Scenario.from_yaml(scenario.to_yaml()) == scenario


def test_frames_are_for_the_only_other_modem_or_as_their_key_says() -> None:
    scenario = parsed("near: {}, far: {serial: 2, to: all}", "near: {}, far: {to: 0}")
    for network, node, to in (
        ("near", "0", "gcs"),
        ("near", "gcs", "0"),
        ("far", "0", None),
        ("far", "gcs", "0"),
    ):
        assert addressee_of(scenario.modems_on(network), node) == to
    three = {node: UaModem(to=to) for node, to in (("0", None), ("1", "gcs"), ("gcs", None))}
    assert [addressee_of(three, node) for node in three] == [None, "gcs", None]


@pytest.mark.parametrize(
    ("ua", "ground", "agent", "text"),
    [
        ("away: {}", "", "still", "nodes.0.modems.away: node 0 has no radio away; it has: main, near, far"),
        ("near: {}, far: {}", "", "still", "two modems are at one serial port"),
        ("near: {serial: 3}", "", "still", "serial"),
        ("near: {baud: 0}", "", "still", "baud"),
        ("main: {}", "", "still", "packets of perfect take no time .medium: ideal.: a modem needs a radio"),
        ("", "near: {serve: ['tcpin:here']}", "still", "'tcpin:here' is not tcpin:HOST:PORT"),
        ("", "near: {serve: ['http://there']}", "still", "is none of tcp:HOST:PORT"),
        ("", "near: {serial: 1}", "still", "serial"),
        (
            "near: {to: gcs}",
            "far: {}",
            "still",
            "near.to: no other node gcs has a modem on near; there are: all",
        ),
        (
            "near: {to: 0}",
            "near: {}",
            "still",
            "near.to: no other node 0 has a modem on near; there are: all, gcs",
        ),
        ("", "near: {}", "free", "nodes.gcs.modems: needs an agent of ours"),
    ],
)
def test_a_modem_that_cannot_be_is_refused_with_its_key(ua: str, ground: str, agent: str, text: str) -> None:
    with pytest.raises(ScenarioError, match=text) as caught:
        parsed(ua, ground, agent)
    assert "modems" in str(caught.value)
