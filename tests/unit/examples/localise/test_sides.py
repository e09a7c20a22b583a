"""The layout of localise_sides.yaml: from one side the direction across is open, from both it is not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from localisation.estimator import Area, Estimator, bound_m2
from localisation.model import Spread, reading

from tests.unit.examples.localise import world
from tests.unit.examples.localise.world import EXPONENT, Floats, mean_power, readings_dbm, shadowing_of

FILE = Path(__file__).parents[4] / "examples" / "localise" / "localise_sides.yaml"


@pytest.fixture(scope="module")
def layout() -> dict[str, Any]:
    """The scenario's nodes by id."""
    return {str(node["id"]): node for node in yaml.safe_load(FILE.read_text())["nodes"]}


def spread_of(layout: dict[str, Any]) -> Spread:
    shadowing = layout["0"]["sensor"]["radio"]["shadowing"]
    power_db = layout["0"]["agent"]["options"]["power_sigma_db"]
    return Spread(shadowing["sigma_db"], shadowing["decorrelation_m"], world.SPREAD.white_db, power_db)


def along_the_side(options: dict[str, Any], spacing_m: float = 6.0) -> Floats:
    """There and back along the middle of a fence."""
    south, north = options["fence"]["north_m"]
    way = np.arange(south, north, spacing_m)
    way = np.concatenate([way, way[::-1]])
    east = np.full(len(way), np.mean(options["fence"]["east_m"]))
    return np.stack([way, east, np.full(len(way), -float(options["altitude_m"]))], axis=-1)


def deviations_m(places: list[Floats], emitter: Floats, spread: Spread) -> Floats:
    """Cramer and Rao's least standard deviations of north and east, with the law's slopes in closed form."""
    information = np.diag([0.0, 0.0, 1.0 / spread.power_db**2])
    for each in places:
        from_each = emitter - each
        slopes = -10.0 * EXPONENT / np.log(10.0) * from_each / np.sum(from_each**2, axis=-1, keepdims=True)
        rates = np.stack([slopes[:, 0], slopes[:, 1], np.ones(len(each))], axis=-1)
        away = np.linalg.norm(each[:, np.newaxis] - each, axis=-1)
        covariance = spread.shadowing_db**2 * np.exp(-away / spread.decorrelation_m)
        covariance += spread.white_db**2 * np.eye(len(each))
        information += rates.T @ np.linalg.inv(covariance) @ rates
    return np.sqrt(np.diag(np.linalg.inv(information)))[:2]


def test_the_direction_across_is_open_for_one_and_closed_for_two(layout: dict[str, Any]) -> None:
    place = layout["beacon"]["place"]
    emitter, spread = np.array([place["north_m"], place["east_m"], -2.0]), spread_of(layout)
    sides = [along_the_side(layout[node]["agent"]["options"]) for node in ("0", "1")]
    alone, team = (
        [deviations_m([side], emitter, spread) for side in sides],
        deviations_m(sides, emitter, spread),
    )
    assert team[1] < 10.0
    for one in alone:
        assert one[1] > 5.0 * team[1]
        assert np.hypot(*one) > 2.5 * np.hypot(*team)
    found = bound_m2(lambda e, p: mean_power(e, p) + 20.0, spread, emitter, sides)
    np.testing.assert_allclose(np.sqrt(np.diag(found)), team, rtol=1e-3)


def drawn(
    layout: dict[str, Any], emitter: Floats, power_dbm: float, rng: np.random.Generator
) -> list[tuple[float, float]]:
    """Error (m) and NEES per axis, of the readings of UA 0, of UA 1 and of both, each flying along its side."""
    options, spread = layout["0"]["agent"]["options"], spread_of(layout)
    area = Area(*(tuple(options["area"][axis]) for axis in ("north_m", "east_m")))
    sides = {node: along_the_side(layout[node]["agent"]["options"], 12.0) for node in ("0", "1")}
    powers = {
        node: readings_dbm(places, emitter, power_dbm, shadowing_of(places, rng), rng)
        for node, places in sides.items()
    }
    found = []
    for team in (("0",), ("1",), ("0", "1")):
        estimator = Estimator(area, lambda e, p: mean_power(e, p) + options["emitters"]["beacon"], spread)
        for node in team:
            for k, (place, dbm) in enumerate(zip(sides[node].tolist(), powers[node].tolist(), strict=True)):
                estimator.add(node, reading(k, 0, k, tuple(place), dbm))
        estimate = estimator.estimate()
        away = estimate.place_m - emitter[:2]
        nees = float(away @ np.linalg.solve(estimate.covariance_m2, away)) / 2.0
        found.append((float(np.hypot(*away)), nees))
    return found


@pytest.mark.slow
def test_the_median_error_alone_is_several_times_that_of_both(
    layout: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(world, "SIGMA_DB", spread_of(layout).shadowing_db)
    place, power_dbm = layout["beacon"]["place"], layout["beacon"]["power_dbm"]
    emitter = np.array([place["north_m"], place["east_m"], -2.0])
    every = [drawn(layout, emitter, power_dbm, np.random.default_rng([7, seed])) for seed in range(25)]
    of_0, of_1, of_both = np.median(np.array(every)[:, :, 0], axis=0)
    assert min(of_0, of_1) > 2.5 * of_both
    assert of_both < 25.0


@pytest.mark.slow
def test_nobody_claims_to_know_more_than_it_does_of_emitters_drawn_from_the_prior(
    layout: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mean NEES of 40 has a sigma of about 0.17. With shadowing taken for independent it is 1.6."""
    monkeypatch.setattr(world, "SIGMA_DB", spread_of(layout).shadowing_db)
    options = layout["0"]["agent"]["options"]
    low, high = np.transpose([options["area"]["north_m"], options["area"]["east_m"]])
    every = []
    for seed in range(40):
        rng = np.random.default_rng([8, seed])
        power_dbm = rng.normal(options["emitters"]["beacon"], options["power_sigma_db"])
        every.append(drawn(layout, np.append(rng.uniform(low, high), -2.0), power_dbm, rng))
    for nees in np.mean(np.array(every)[:, :, 1], axis=0):
        assert 0.5 < nees < 1.5
