"""Where an agent is: the fleet's frame, the autopilot's own, the earth; and that it is told no nan."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bridge.agents.client import UaClient
from bridge.agents.frames import Frames, frames_of
from bridge.agents.latest import LatestPackages
from bridge.agents.measurements import Measurement
from bridge.bus.messages import AircraftState, CommandEvent, CommandGoal, DataPackage, Vector3, encode
from bridge.scenario.file import parse_scenario
from fdm.model.geodesy import GeodeticPosition

FRAMES = Frames(GeodeticPosition(47.0, 8.0, 400.0), (200.0, -100.0, 0.0))
FIX = AircraftState(latitude_deg=47.0, longitude_deg=8.0, position_ned_m=Vector3(1.0, 2.0, -30.0))
NO_FIX = replace(FIX, position_ned_m=Vector3(math.nan, math.nan, math.nan))


class Heard:
    """Keeps what is asked of the aircraft."""

    def __init__(self) -> None:
        self.goals: list[dict[str, Any]] = []

    def command(self, verb: str, goal: CommandGoal, on_event: Any) -> None:
        self.goals.append({"verb": verb, **json.loads(goal.arguments or "{}")})
        on_event(CommandEvent(CommandEvent.RESULT, True, "", outcome="reached"))


@pytest.fixture
def outlet() -> Heard:
    return Heard()


@pytest.fixture
def ua(outlet: Heard) -> UaClient:
    return UaClient("1", outlet, frames=FRAMES, sensor=object())  # type: ignore[arg-type]


def test_places_of_one_frame_are_those_of_another() -> None:
    assert FRAMES.fleet_from_own((1.0, 2.0, -30.0)) == (201.0, -98.0, -30.0)
    assert FRAMES.own_from_fleet((201.0, -98.0, -30.0)) == (1.0, 2.0, -30.0)
    earth = FRAMES.earth_from_fleet((111.318845, 0.0, -20.0))
    assert (earth.lat_deg, earth.lon_deg, earth.alt_amsl_m) == pytest.approx((47.001, 8.0, 420.0))
    place = FRAMES.fleet_from_earth(earth.lat_deg, earth.lon_deg, earth.alt_amsl_m)
    assert place == pytest.approx((111.318845, 0.0, -20.0), abs=1e-6)


def test_a_ground_node_counts_in_the_fleets_frame() -> None:
    text = """\
{schema: 1, name: a, duration_s: 1, radio: perfect, origin: {lat_deg: 47, lon_deg: 8, alt_amsl_m: 400}, nodes: [
{id: 0, home: {north_m: 5, east_m: 6}, agent: {type: still}},
{id: gcs, kind: ground, place: {north_m: 7}, agent: {type: still}}]}
"""
    scenario = parse_scenario(text, "a", Path.cwd(), {})
    assert frames_of(scenario, "0").home_ned_m == (5.0, 6.0, 0.0)
    assert frames_of(scenario, "gcs") == Frames(GeodeticPosition(47.0, 8.0, 400.0))


async def test_goto_ned_takes_a_place_of_the_fleet(ua: UaClient, outlet: Heard) -> None:
    await ua.goto_ned(250.0, 0.0, -40.0, frame="fleet", within_m=5.0)
    place = {"north_m": 50.0, "east_m": 100.0, "down_m": -40.0}
    assert outlet.goals == [{"verb": "goto_ned", **place, "frame": "origin", "within_m": 5.0}]
    await ua.goto_ned(250.0, 0.0, -40.0, frame="fleet", speed_mps=12)
    assert outlet.goals[1] == {"verb": "goto_ned", **place, "speed_mps": 12.0, "frame": "origin"}
    blind = UaClient("1", outlet)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="not known here"):
        await blind.goto_ned(250.0, 0.0, -40.0, frame="fleet")


def test_there_is_no_state_before_the_first_fix(ua: UaClient) -> None:
    ua.take_state(NO_FIX)
    assert (ua.state, ua.place_ned_m) == (None, None)
    assert math.isnan(ua.told.position_ned_m.x)
    ua.take_state(FIX)
    assert (ua.state, ua.place_ned_m) == (FIX, (201.0, -98.0, -30.0))
    ua.take_state(NO_FIX)
    assert ua.state is None, "an autopilot that boots anew"


async def test_conditions_do_not_see_a_state_without_a_fix(ua: UaClient) -> None:
    ua.take_state(NO_FIX)
    waiting = ua.wait_for(lambda state: state.position_ned_m.z > -50.0)
    waiting.send(None)
    ua.take_state(NO_FIX)
    ua.take_state(FIX)
    with pytest.raises(StopIteration) as done:
        waiting.send(None)
    assert done.value.value is FIX


def test_others_are_not_in_latest_before_their_first_fix(ua: UaClient) -> None:
    latest = LatestPackages(ua)
    latest.take("0", encode(DataPackage(state=NO_FIX)))
    assert ("0" in latest, len(latest), list(latest.raw), ua.malformed) == (False, 0, ["0"], 0)
    latest.take("0", encode(DataPackage(state=FIX)))
    assert latest["0"].state.position_ned_m.z == -30.0
    assert latest[0] is latest["0"]  # as scenarios write ids


def test_a_measurement_has_its_place_in_the_fleets_frame(ua: UaClient) -> None:
    ua.take_clock(50)
    ua.take_state(FIX)
    ua.take_measurements([Measurement(50, 0, -60.0), Measurement(0, 0, -61.0)])
    assert [each.place_ned_m for each in ua.measurements] == [(201.0, -98.0, -30.0), None]
