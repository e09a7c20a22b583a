"""Where the planner sends a UA, against what is plain to see."""

from __future__ import annotations

import numpy as np
from localisation.estimator import Estimate
from localisation.planner import Fence, Planner, PlannerSettings, Situation, Way, way_of

from tests.unit.examples.localise.world import SPREAD, Floats, mean_power

FENCE = Fence((-250.0, 250.0), (-250.0, 250.0))


def planner(**changes: object) -> Planner:
    settings = PlannerSettings(FENCE, 12.0, 40.0, horizon_s=12.0)
    return Planner(
        PlannerSettings(**{**{s: getattr(settings, s) for s in settings.__slots__}, **changes}),
        mean_power,
        SPREAD,
    )


def estimate(north_m: float, east_m: float, sigma_m: tuple[float, float] = (30.0, 30.0)) -> Estimate:
    covariance = np.diag(np.square(sigma_m))
    information = np.diag([1.0 / sigma_m[0] ** 2, 1.0 / sigma_m[1] ** 2, 1.0 / 9.0])
    place = np.array([north_m, east_m])
    return Estimate(place, covariance, information, place[np.newaxis], 50, is_fine=True)


def situation(
    place: Floats, *estimates: Estimate, companions: tuple[Way, ...] = (), own: Floats | None = None
) -> Situation:
    own_ned_m = np.zeros((0, 3)) if own is None else own
    return Situation(place, 0.0, estimates, own_ned_m, companions, (-40.0,) * len(companions))


def test_it_goes_to_where_the_emitter_is_believed() -> None:
    for north_m, east_m in ((150.0, 0.0), (0.0, -150.0), (110.0, 110.0)):
        way = planner().plan(situation(np.zeros(2), estimate(north_m, east_m)))
        gained = np.hypot(north_m, east_m) - np.hypot(*(way.places_m[-1] - (north_m, east_m)))
        assert gained > 80.0, way


def test_legs_are_as_long_as_the_horizon_says() -> None:
    way = planner().plan(situation(np.zeros(2), estimate(100.0, 50.0)))
    np.testing.assert_allclose(way.after_s, (0.0, 6.0, 12.0))
    np.testing.assert_allclose(np.linalg.norm(np.diff(way.places_m, axis=0), axis=1), 72.0)


def test_it_stays_inside_the_fence_and_comes_back_into_it() -> None:
    inside = planner().plan(situation(np.array([200.0, 200.0]), estimate(400.0, 400.0)))
    assert np.all(FENCE.beyond_m(inside.places_m) < 1e-9)
    outside = planner().plan(situation(np.array([200.0, 320.0]), estimate(400.0, 400.0)))
    assert FENCE.beyond_m(outside.places_m)[-1] == 0.0


def test_it_keeps_away_from_where_its_companion_will_be() -> None:
    goal = estimate(150.0, 0.0)
    alone = planner().plan(situation(np.zeros(2), goal))
    other = Way(alone.after_s, alone.places_m + np.array([0.0, 5.0]))
    kept = planner().plan(situation(np.zeros(2), goal, companions=(other,)))
    times = np.linspace(1.0, 12.0, 23)
    # both begin 5 m apart: from there the distance only grows, and is 40 m as soon as a leg lets it be
    apart = np.linalg.norm(kept.at(times) - other.at(times), axis=-1)
    assert apart[-1] > 40.0
    assert np.all(np.linalg.norm(kept.at(times[6:]) - other.at(times[6:]), axis=-1) > 39.0)


def test_of_two_emitters_it_leaves_to_its_companion_the_one_that_this_one_will_measure() -> None:
    emitters = (estimate(115.0, 0.0), estimate(-120.0, 0.0))
    alone = planner().plan(situation(np.zeros(2), *emitters)).places_m[-1, 0]
    side = np.sign(alone)
    assert abs(alone) > 50.0
    points = np.array([[150.0 * side, -60.0], [80.0 * side, 0.0], [150.0 * side, 60.0]])
    passes_there = Way(np.array([0.0, 6.0, 12.0]), points)
    assert (
        planner().plan(situation(np.zeros(2), *emitters, companions=(passes_there,))).places_m[-1, 0] * side
        < -50.0
    )


def test_it_does_not_fly_where_it_measured_already() -> None:
    """The emitter is in a row with places measured west of it; an equal row east of it is new."""
    goal = estimate(0.0, 0.0)
    west = np.stack(
        [np.tile(np.linspace(-30.0, 30.0, 5), 8), np.repeat(np.linspace(-120.0, -10.0, 8), 5)], axis=-1
    )
    own = np.concatenate([west, np.full((40, 1), -40.0)], axis=-1)
    ends = [
        planner().plan(situation(np.array([-20.0, 0.0]), goal, own=own * (1.0, side, 1.0))).places_m[1:, 1]
        for side in (1.0, -1.0)
    ]
    assert np.all(ends[0] > 0.0)
    assert np.all(ends[1] < 0.0)


def test_fixed_wing_turn_no_more_than_they_can() -> None:
    for north_m, east_m in ((-200.0, 0.0), (0.0, 200.0), (0.0, -200.0)):
        way = planner(most_turn_deg=60.0).plan(situation(np.zeros(2), estimate(north_m, east_m)))
        first = np.degrees(np.arctan2(*(way.places_m[1] - way.places_m[0])[::-1]))
        assert abs(first) <= 60.0 + 1e-6


def test_a_told_plan_is_seen_from_now_and_ends() -> None:
    points = [(10 * 10**9, 0.0, 0.0), (20 * 10**9, 100.0, 50.0)]
    way = way_of(15 * 10**9, points)
    assert way is not None
    np.testing.assert_allclose(
        way.at(np.array([0.0, 5.0, 9.0])), [[50.0, 25.0], [100.0, 50.0], [100.0, 50.0]]
    )
    assert way_of(20 * 10**9, points) is None
    assert way_of(0, []) is None
