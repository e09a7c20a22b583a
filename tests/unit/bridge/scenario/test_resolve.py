"""From the keys of a scenario to what the flight dynamics are given."""

from __future__ import annotations

from bridge.scenario.file import SCENARIOS, parse_scenario
from bridge.scenario.resolve.flight import disturb_of, legacy_of
from bridge.scenario.sections import FlightDynamics
from standin.cli import RATE_HZ_MAX, RATE_HZ_MIN

TEXT = (SCENARIOS / "separation.yaml").read_text(encoding="utf-8")
EXACT = (0.0,) * 16


def scenario_with(fdm: str, ua_0: str = "", autopilot: str = "external"):
    text = TEXT.replace("seed: 1", f"seed: 1\nfdm: {fdm}", 1).replace("airframe:", f"{ua_0}airframe:", 1)
    return parse_scenario(text.replace("autopilot: standin", f"autopilot: {autopilot}"), "x")


def test_sensors_are_exact_unless_the_scenario_says_otherwise() -> None:
    scenario = scenario_with("{workers: 2}")
    assert [disturb_of(scenario, ua) for ua in scenario.ua] == [None, None]
    assert scenario.fdm.workers == 2


def test_sensor_noise_of_a_ua_takes_the_place_of_the_fleets() -> None:
    scenario = scenario_with(
        "{sensor_noise: {accel_bias_frd_mps2: [1, 0, 0]}}",
        "sensor_noise: {gyro_bias_frd_radps: [0, 2, 0]}\n    ",
    )
    own, fleets = (disturb_of(scenario, ua)(lambda: EXACT)() for ua in scenario.ua)
    assert own == (0.0, 2.0, *EXACT[2:])
    assert fleets == (*EXACT[:3], 1.0, *EXACT[4:])


def test_the_legacy_scheme_has_the_papers_ports() -> None:
    scenario = scenario_with("{scheme: legacy, legacy_rate_hz: 250}")
    assert [scenario.fdm_port(ua) for ua in scenario.ua] == [5502, 5505]
    peers = [legacy_of(scenario, ua) for ua in scenario.ua]
    assert [(peer.state_port, peer.rate_hz) for peer in peers] == [(5501, 250), (5504, 250)]
    assert legacy_of(scenario_with("{}"), scenario.ua[0]) is None


def test_a_scenario_may_ask_for_the_rates_that_the_stand_in_takes() -> None:
    limits = FlightDynamics.model_json_schema()["properties"]["standin_rate_hz"]
    assert (limits["minimum"], limits["maximum"]) == (RATE_HZ_MIN, RATE_HZ_MAX)
