"""Who flies which UA: what a scenario may say of it."""

from __future__ import annotations

import pytest

from bridge.fleet.preflight.ports import ports_of
from bridge.scenario.file import ScenarioError, parse_scenario
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.flight import px4_of

TEXT = """\
schema: 1
name: fleet
duration_s: 10
origin: {lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690}
radio: sik-433
processes: many
ports: {first_slot: 30}
nodes:
  - {id: 0, agent: {type: still}}
  - {id: 1, autopilot: px4, home: {east_m: 9}, agent: {type: still}}
  - {id: 2, autopilot: ardupilot, home: {east_m: 18}, agent: {type: still}}
"""
WITH_MODEM = TEXT.replace("autopilot: px4,", "autopilot: px4, modems: {main: {serial: 1}},")


def parsed(text: str) -> Scenario:
    return parse_scenario(text, "my.yaml")


def test_each_ua_is_flown_by_its_own_autopilot_or_by_the_fleets() -> None:
    mixed = parsed(TEXT)
    assert [mixed.autopilot_of(ua) for ua in mixed.ua] == ["standin", "px4", "ardupilot"]
    assert mixed.autopilots == {"standin", "px4", "ardupilot"}
    other = parsed(TEXT.replace("ports:", "autopilot: external\nports:"))
    assert [other.autopilot_of(ua) for ua in other.ua] == ["external", "px4", "ardupilot"]
    assert px4_of(mixed, mixed.ua[0]) is None
    peer = px4_of(mixed, mixed.ua[1])
    assert peer is not None
    assert peer.wake_ports == (6070,), "5760 + 10 (30 + 1)"


def test_ports_are_those_of_each_ones_autopilot() -> None:
    """PX4's simulator is at 4560 + I; its MAVLink goes by UDP from where ArduPilot's TCP port is to the next."""
    found = {(use.transport, use.port) for use in ports_of(parsed(TEXT)) if use.port not in range(6760, 7500)}
    standin = {("UDP", 9302), ("TCP", 6060)}
    px4 = {("TCP", 4591), ("UDP", 6070), ("UDP", 6071)}
    ardupilot = {("UDP", 9322), ("TCP", 6080), ("TCP", 6082), ("TCP", 6083)}
    assert found == standin | px4 | ardupilot


@pytest.mark.parametrize(
    ("text", "mistake"),
    [
        (
            TEXT.replace("ports:", "fdm: {scheme: legacy}\nports:"),
            "fdm.scheme: legacy is for autopilot: external; the others speak json only",
        ),
        (WITH_MODEM, "modems: UA 1 is flown by PX4, which has no second serial port here"),
        (
            TEXT.replace("autopilot: px4,", "autopilot: px4, parameters: {PWM_MAIN_FUNC2: 102},"),
            "nodes.1.parameters.PWM_MAIN_FUNC2: UA 1 is flown by PX4: this is the airframe's, in its section px4",
        ),
        (
            TEXT.replace("ports:", "parameters: {PWM_MAIN_FUNC11: 0}\nports:"),
            " parameters.PWM_MAIN_FUNC11: UA 1 is flown by PX4: this is the airframe's, in its section px4",
        ),
        (TEXT.replace("autopilot: px4", "autopilot: px5"), "nodes.1.autopilot"),
        (
            TEXT + "fdm: {px4: {imu_rate_hz: 130}}\n",
            "fdm.px4.magnetometer_rate_hz: has to divide imu_rate_hz, 130 (got 50)",
        ),
    ],
)
def test_what_an_autopilot_cannot_do_is_refused_in_a_line(text: str, mistake: str) -> None:
    with pytest.raises(ScenarioError) as told:
        parsed(text)
    (line,) = str(told.value).splitlines()
    assert mistake in line


def test_the_same_is_no_mistake_where_another_flies() -> None:
    parsed(WITH_MODEM.replace("px4", "ardupilot"))
    parsed(TEXT.replace("px4", "ardupilot").replace("ports:", "parameters: {PWM_MAIN_FUNC1: 0}\nports:"))
    parsed(TEXT.replace("autopilot: px4,", "autopilot: px4, parameters: {PWM_MAIN_MIN1: 1000},"))
