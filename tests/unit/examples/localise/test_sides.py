"""The layout of localise_sides.yaml: neither UA finds the emitter from its side, both together do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from localisation.estimator import Area, bound_m2
from localisation.localiser import Localiser, Settings
from localisation.model import Spread
from localisation.planner import Fence, PlannerSettings

from tests.unit.examples.localise import world
from tests.unit.examples.localise.world import EXPONENT, Floats, Flyer, Sensor, mean_power

FILE = Path(__file__).parents[4] / "examples" / "localise" / "localise_sides.yaml"


@pytest.fixture(scope="module")
def layout() -> dict[str, Any]:
    """The scenario's nodes by id."""
    return {str(node["id"]): node for node in yaml.safe_load(FILE.read_text())["nodes"]}


def spread_of(layout: dict[str, Any]) -> Spread:
    shadowing = layout["0"]["sensor"]["radio"]["shadowing"]
    power_db = layout["0"]["agent"]["options"]["power_sigma_db"]
    return Spread(shadowing["sigma_db"], shadowing["decorrelation_m"], world.SPREAD.white_db, power_db)


def along_the_side(options: dict[str, Any]) -> Floats:
    """There and back along the middle of a fence, a place each 6 m."""
    south, north = options["fence"]["north_m"]
    way = np.arange(south, north, 6.0)
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


def errors_m(layout: dict[str, Any], delivery: float, monkeypatch: pytest.MonkeyPatch) -> Floats:
    """Of both UA at 120 s."""
    spread, place = spread_of(layout), layout["beacon"]["place"]
    monkeypatch.setattr(world, "SIGMA_DB", spread.shadowing_db)
    emitter = np.array([place["north_m"], place["east_m"], -2.0])
    flyers = {}
    for node in ("0", "1"):
        options, home = layout[node]["agent"]["options"], layout[node]["home"]
        fence = Fence(*(tuple(options["fence"][axis]) for axis in ("north_m", "east_m")))
        area = Area(*(tuple(options["area"][axis]) for axis in ("north_m", "east_m")))
        planner = PlannerSettings(fence, options["speed_mps"], options["altitude_m"], options["horizon_s"])
        localiser = Localiser(node, Settings(options["emitters"], area, planner), mean_power, spread)
        sensor = Sensor(emitter, layout["beacon"]["power_dbm"], np.random.default_rng([4, int(node)]))
        flyers[node] = Flyer(localiser, np.array([home["north_m"], home["east_m"]], dtype=float), sensor)
    world.fly(flyers, 120, lambda _: delivery, np.random.default_rng(4), replan_s=6)
    places = [each.localiser.estimates[0].place_m for each in flyers.values()]
    return np.hypot(*(np.stack(places) - emitter[:2]).T)


@pytest.mark.slow
def test_each_is_lost_alone_and_neither_in_a_team(
    layout: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    alone, shared = (errors_m(layout, delivery, monkeypatch) for delivery in (0.0, 1.0))
    assert np.all(shared < 30.0)
    assert np.all(alone > 50.0)
