"""The mission without autopilots and radio: what messages bring, and that two find an emitter that one would not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from localisation.estimator import Area
from localisation.localiser import Localiser, Settings
from localisation.planner import Fence, PlannerSettings

from tests.unit.examples.localise import world
from tests.unit.examples.localise.world import SPREAD, Flyer, Sensor, mean_power

BEACON_NED_M = np.array([140.0, 220.0, -2.0])
AREA = Area((-280.0, 280.0), (-360.0, 360.0))


def localiser(
    node: str, east_m: tuple[float, float] = (-340.0, -60.0), altitude_m: float = 45.0, **changes: object
) -> Localiser:
    planner = PlannerSettings(Fence((-250.0, 250.0), east_m), 12.0, altitude_m, horizon_s=12.0)
    return Localiser(node, Settings({"beacon": 20.0}, AREA, planner, **changes), mean_power, SPREAD)


def measure(of: Localiser, count: int, seed: int = 1) -> list[bytes]:
    """Readings along a line, a message after every fourth."""
    rng = np.random.default_rng(seed)
    sensor = Sensor(BEACON_NED_M, 19.0, rng)
    messages = []
    for number in range(count):
        place = np.array([-100.0 + 6.0 * number, 120.0, -40.0])
        of.measured(number, "beacon", number * 5 * 10**8, place, sensor.read(place))
        if number % 4 == 3:
            messages.append(of.message())
    return messages


def test_what_two_know_is_the_same_to_the_bit_however_late_messages_come() -> None:
    one, on_time, late = localiser("0"), localiser("1"), localiser("2")
    messages = measure(one, 40)
    for message in messages:
        assert on_time.received("0", message)
    for message in [*messages[::-1], *messages[::3]]:
        assert late.received("0", message)
        late.estimates  # noqa: B018
    for other in (on_time, late):
        assert other.readings("0") == one.readings("0") == 40
        assert np.array_equal(other.estimates[0].place_m, one.estimates[0].place_m)
        assert np.array_equal(other.estimates[0].covariance_m2, one.estimates[0].covariance_m2)


def test_one_lost_message_is_made_up_for_by_the_next_two_are_not() -> None:
    messages = measure(localiser("0"), 40)
    for repeats, lost, expected in ((1, {4}, 40), (1, {4, 5}, 36), (0, {4}, 36), (2, {4, 5}, 40)):
        messages, hearer = measure(localiser("0", repeats=repeats), 40), localiser("1")
        for index, message in enumerate(messages):
            if index not in lost:
                hearer.received("0", message)
        assert hearer.readings("0") == expected


def test_readings_in_one_place_count_once() -> None:
    one = localiser("0")
    place = (10.0, 20.0, -40.0)
    assert one.measured(1, "beacon", 0, place, -60.0)
    assert not one.measured(2, "beacon", 10**9, place, -61.0)
    assert not one.measured(3, "stranger", 2 * 10**9, (99.0, 20.0, -40.0), -61.0)
    assert one.readings("0") == 1


def test_a_plan_knows_where_it_measured_though_the_first_emitter_is_silent() -> None:
    ways = []
    for silent in ("a", "z"):
        one = localiser("0", east_m=(-340.0, 340.0))
        one = Localiser(
            "0", replace(one.settings, emitters={"beacon": 20.0, silent: 20.0}), mean_power, SPREAD
        )
        measure(one, 25)
        ways.append(one.plan(0, np.array([-100.0, 180.0]), 0.0).places_m)
    assert np.array_equal(*ways)


@pytest.mark.parametrize("payload", [b"", b"hello", bytes(40)])
def test_what_is_no_message_is_counted_and_changes_nothing(payload: bytes) -> None:
    one = localiser("0")
    before = one.estimates[0].place_m
    assert not one.received("1", payload)
    assert one.malformed == 1
    assert np.array_equal(one.estimates[0].place_m, before)


def errors_m(delivery: Callable[[float], float], seed: int) -> list[float]:
    flyers = {
        node: Flyer(
            localiser(node, east_m, altitude_m),
            np.array(start),
            Sensor(BEACON_NED_M, 18.0, np.random.default_rng([seed, int(node)])),
        )
        for node, east_m, altitude_m, start in (
            ("0", (-340.0, -60.0), 45.0, (-150.0, -200.0)),
            ("1", (60.0, 340.0), 30.0, (-150.0, 200.0)),
        )
    }
    world.fly(flyers, 120, delivery, np.random.default_rng(seed), replan_s=6)
    return [
        float(np.hypot(*(each.localiser.estimates[0].place_m - BEACON_NED_M[:2]))) for each in flyers.values()
    ]


@pytest.mark.long
@pytest.mark.slow
def test_with_sharing_both_know_without_it_the_far_one_does_not() -> None:
    shared, alone = (np.array([errors_m(lambda _, p=p: p, seed) for seed in (1, 2, 3)]) for p in (1.0, 0.0))
    assert np.median(shared[:, 0]) < 15.0
    np.testing.assert_allclose(shared[:, 0], shared[:, 1], atol=3.0)
    assert np.median(alone[:, 0]) > 2.0 * np.median(shared[:, 0])
