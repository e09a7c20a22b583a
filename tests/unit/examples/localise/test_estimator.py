"""The estimator against readings drawn by closed forms of the test's own: consistent, bounded, blind to order."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from localisation.estimator import Area, Estimator, bound_m2
from localisation.model import Reading, reading
from localisation.track import NEIGHBOURS, Track
from scipy import stats

from tests.unit.examples.localise import world
from tests.unit.examples.localise.world import DECORRELATION_M, SIGMA_DB, SPREAD, Floats

AREA = Area((-280.0, 280.0), (-360.0, 360.0))
BELIEVED_DBM, RUNS, READINGS = 20.0, 100, 60


def law(emitters: Floats, places: Floats) -> Floats:
    return world.mean_power(emitters, places) + BELIEVED_DBM


def track_ned_m(rng: np.random.Generator, emitter_ned_m: Floats, height_m: float) -> Floats:
    """A curve of 8 m steps about some point that is as far from the emitter as the mission's second half is."""
    along = 8.0 * np.arange(READINGS)
    centre = emitter_ned_m[:2] + rng.uniform(-40.0, 40.0, 2)
    angle, phase = along / 75.0, rng.uniform(0.0, 2.0 * np.pi)
    north, east = centre[0] + 90.0 * np.sin(angle + phase), centre[1] + 70.0 * np.cos(1.3 * angle)
    return np.stack([north, east, np.full(READINGS, -height_m)], axis=-1)


def readings_of(places: Floats, emitter: Floats, power_dbm: float, rng: np.random.Generator) -> list[Reading]:
    powers = world.readings_dbm(places, emitter, power_dbm, world.shadowing_of(places, rng), rng)
    return [
        reading(k, 0, k, (float(p[0]), float(p[1]), float(p[2])), float(power))
        for k, (p, power) in enumerate(zip(places, powers, strict=True))
    ]


@cache
def results() -> dict[str, Floats]:
    """Of runs with an emitter drawn from the prior, place and power: NEES, squared error, bound, after three tracks."""
    rows = []
    for seed in range(RUNS):
        rng = np.random.default_rng([13, seed])
        emitter = np.array([rng.uniform(-230.0, 230.0), rng.uniform(-310.0, 310.0), -2.0])
        power_dbm = rng.normal(BELIEVED_DBM, SPREAD.power_db)
        tracks = [track_ned_m(rng, emitter, height_m) for height_m in (30.0, 40.0, 50.0)]
        estimator = Estimator(AREA, law, SPREAD)
        for node, places in enumerate(tracks):
            for each in readings_of(places, emitter, power_dbm, rng):
                estimator.add(str(node), each)
        found = estimator.estimate()
        error = found.place_m - emitter[:2]
        bound = bound_m2(law, SPREAD, emitter, tracks)
        nees = error @ np.linalg.solve(found.covariance_m2, error)
        rows.append((nees, error @ error, np.trace(bound), found.is_fine))
    return dict(zip(("nees", "squared", "bound", "fine"), np.array(rows, dtype=float).T, strict=True))


@pytest.mark.slow
def test_the_error_is_as_large_as_the_covariance_says() -> None:
    low, high = stats.chi2(2 * RUNS).ppf([0.025, 0.975]) / RUNS
    assert low < np.mean(results()["nees"]) < high


@pytest.mark.slow
def test_the_error_is_near_the_bound_and_not_below_it() -> None:
    """Mean of squared error over bound where one place is left: 1 for an efficient estimator (each has variance <= 2).

    In the others a second place, farther away with more power, still explains the readings; the bound, which knows the
    law's slope at one place only, does not say so, the covariance does.
    """
    fine = results()["fine"] > 0
    ratio = results()["squared"][fine] / results()["bound"][fine]
    assert abs(np.mean(ratio) - 1.0) < 3.0 * np.sqrt(2.0 / len(ratio)), np.mean(ratio)
    assert np.mean(fine) > 0.8
    assert np.sqrt(np.mean(results()["squared"])) > np.sqrt(np.mean(results()["bound"]))


def test_neglecting_that_shadowing_is_correlated_is_seen() -> None:
    """What the first test would say of an estimator that takes readings for independent."""
    rng = np.random.default_rng(2)
    emitter = np.array([30.0, -80.0, -2.0])
    naive = world.Spread(SPREAD.shadowing_db, None, SPREAD.white_db, SPREAD.power_db)
    nees = []
    for _ in range(20):
        estimator = Estimator(AREA, law, naive)
        for each in readings_of(track_ned_m(rng, emitter, 40.0), emitter, BELIEVED_DBM, rng):
            estimator.add("0", each)
        found = estimator.estimate()
        error = found.place_m - emitter[:2]
        nees.append(error @ np.linalg.solve(found.covariance_m2, error))
    assert np.mean(nees) > stats.chi2(40).ppf(0.975) / 20


def some_readings(seed: int = 5, count: int = 60) -> dict[str, list[Reading]]:
    rng = np.random.default_rng(seed)
    emitter = np.array([60.0, 90.0, -2.0])
    return {
        str(node): readings_of(track_ned_m(rng, emitter, 40.0)[:count], emitter, 19.0, rng) for node in (0, 1)
    }


@pytest.mark.parametrize("seed", range(3))
def test_late_reordered_and_repeated_readings_give_the_same_bits(seed: int) -> None:
    told = [(node, each) for node, items in some_readings().items() for each in items]
    on_time, jumbled = Estimator(AREA, law, SPREAD), Estimator(AREA, law, SPREAD)
    for node, each in sorted(told, key=lambda item: item[1].number):
        assert on_time.add(node, each)
        if each.number % 7 == 0:
            on_time.estimate()
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(told))
    for step, index in enumerate([*order, *rng.choice(order, 40)]):
        node, each = told[index]
        assert jumbled.add(node, each) == (step < len(told))
        if step % 11 == 0:
            jumbled.estimate()
    for one, other in zip(on_time.estimate(), jumbled.estimate(), strict=True):
        assert np.array_equal(np.asarray(one), np.asarray(other))
    assert np.array_equal(on_time.log_likelihood(), jumbled.log_likelihood())


def test_up_to_so_many_neighbours_the_likelihood_is_the_exact_one() -> None:
    items = some_readings(count=NEIGHBOURS)["0"]
    track = Track(AREA.grid(), law, SPREAD)
    for each in items:
        track.add(each)
    track.update()
    places = np.array([each.place_ned_m for each in items])
    away = np.linalg.norm(places[:, None] - places[None], axis=-1)
    covariance = SIGMA_DB**2 * np.exp(-away / DECORRELATION_M) + SPREAD.white_db**2 * np.eye(len(items))
    residuals = np.array([each.power_dbm for each in items])[:, None] - law(AREA.grid(), places[:, None])
    expected = np.sum(residuals * np.linalg.solve(covariance, residuals), axis=0)
    np.testing.assert_allclose(track.squares, expected, rtol=1e-9)


def test_with_nothing_measured_an_emitter_is_anywhere() -> None:
    found = Estimator(AREA, law, SPREAD).estimate()
    np.testing.assert_allclose(found.place_m, (0.0, 0.0), atol=1e-9)
    np.testing.assert_allclose(np.diag(found.covariance_m2), (560.0**2 / 12.0, 720.0**2 / 12.0), rtol=0.01)


def test_the_bound_of_one_line_is_without_end_across_it() -> None:
    line = np.stack([np.linspace(0.0, 100.0, 21), np.zeros(21), np.full(21, -40.0)], axis=-1)
    bound = bound_m2(law, SPREAD, np.array([50.0, 0.0, -2.0]), [line])
    assert not np.isfinite(bound).all() or bound[1, 1] > 1e6
