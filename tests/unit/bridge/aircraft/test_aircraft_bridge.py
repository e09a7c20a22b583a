"""State at the ticks: stamped with the tick, and published at its rate at any tick rate."""

from __future__ import annotations

import pytest

import bridge.aircraft.aircraft_bridge
import bridge.record.input_fields
from aps.config import DaemonConfig
from aps.held import HeldDaemon
from aps.vehicle.commander import VERBS
from bridge.aircraft.aircraft_bridge import AircraftBridge
from bridge.aircraft.body import StatePace
from bridge.bus.messages import CommandEvent, CommandGoal


@pytest.fixture
def aircraft() -> AircraftBridge:
    return AircraftBridge(HeldDaemon(DaemonConfig(autopilot="tcp:127.0.0.1:1", sysid=1)), "0")


@pytest.mark.parametrize(
    ("tick_rate_hz", "per_s"), [(4, 4), (10, 10), (16, 10), (20, 10), (25, 10), (100, 10)]
)
def test_state_is_published_at_its_rate_at_any_tick_rate(
    aircraft: AircraftBridge, tick_rate_hz: int, per_s: int
) -> None:
    published, pace = 0, StatePace()
    for tick in range(20 * tick_rate_hz):
        now_ns = tick * 1_000_000_000 // tick_rate_hz
        aircraft.begin(now_ns)
        assert aircraft.state().header.stamp.ns == now_ns
        published += pace.is_due(now_ns)
        aircraft.end()
    assert published == 20 * per_s


@pytest.mark.parametrize(
    ("verb", "goal", "says"),
    [
        ("arm", CommandGoal(), "has not been heard"),
        ("goto", CommandGoal(latitude_deg=100.0), "has not been heard"),
        ("dance", CommandGoal(), "dance"),
    ],
)
def test_what_cannot_be_done_is_told_at_once(
    aircraft: AircraftBridge, verb: str, goal: CommandGoal, says: str
) -> None:
    events: list[CommandEvent] = []
    aircraft.begin(0)
    aircraft.start(verb, goal, events.append)
    aircraft.end()
    [event] = events
    assert (event.phase, event.success) == (CommandEvent.RESULT, False)
    assert says in event.text


@pytest.mark.parametrize(
    ("verb", "arguments", "says"),
    [
        ("goto_ned", '{"up_m": 3}', "goto_ned has no argument 'up_m'"),
        ("parameter_get", '{"on_done": 3}', "parameter_get has no argument 'on_done'"),
        ("velocity", "[1, 2]", "arguments are a JSON object"),
        ("velocity", "{", "Expecting property name"),
        ("velocity", "[" * 100_000, "nested too deep"),
    ],
)
def test_wrong_arguments_are_refused_in_words(
    aircraft: AircraftBridge, verb: str, arguments: str, says: str
) -> None:
    events: list[CommandEvent] = []
    aircraft.start(verb, CommandGoal(arguments=arguments), events.append)
    [event] = events
    assert (event.phase, event.success, event.outcome) == (CommandEvent.RESULT, False, "refused")
    assert says in event.text


def test_what_can_be_commanded_over_zenoh_is_what_aps_can_and_is_said_once() -> None:
    assert tuple(VERBS) == bridge.record.input_fields.VERBS
