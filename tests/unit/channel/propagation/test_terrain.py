import csv
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from channel.link.radio import Radio
from channel.presets import load_radio
from channel.propagation.diffraction import Profile, bulge_m, bullington_db, edge_db
from channel.propagation.path_loss import friis_db
from channel.propagation.terrain import Terrain
from channel.validity import OutsideValidityError

DATA = Path(__file__).parents[3] / "data"
PLAIN = {"earth_radius_factor": None, "edges": "worst"}
RIDGE = Terrain(
    spacing_m=10.0, step_m=1.0, heights_m=tuple((60.0 if i == 50 else 0.0,) * 3 for i in range(101)), **PLAIN
)


def over(terrain, tx, rx):
    radio = Radio(load_radio("perfect"))
    return radio.path(position_tx_ned_m=tx, position_rx_ned_m=rx)


def test_knife_edge_values_of_the_standard():
    """ITU-R P.526, figure 9: 6 dB at grazing incidence, 0 at -0.78, 13 dB at 1, 19 dB at 2.4."""
    assert edge_db(np.array([-5.0, -0.78])) == pytest.approx([0.0, 0.0], abs=0.02)
    assert edge_db(np.array([0.0, 1.0, 2.4])) == pytest.approx([6.03, 13.9, 20.5], abs=0.1)


def test_a_ridge_blocks_the_sight_and_costs_what_its_edge_costs():
    path = over(RIDGE, (0.0, 10.0, -20.0), (1000.0, 10.0, -20.0))
    assert not RIDGE.line_of_sight(path)
    nu = 40.0 * np.sqrt(2.0 * 1000.0 / (0.124292 * 500.0 * 500.0))
    expected = friis_db(1000.0, 2.412e9) + edge_db(nu)
    assert float(RIDGE.path_loss_db(path)) == pytest.approx(float(expected), abs=0.05)


def test_high_above_it_there_is_free_space():
    path = over(RIDGE, (0.0, 10.0, -200.0), (1000.0, 10.0, -200.0))
    assert RIDGE.line_of_sight(path)
    assert float(RIDGE.path_loss_db(path)) == pytest.approx(float(friis_db(1000.0, 2.412e9)))


def test_many_links_at_once_and_both_ways():
    tx = np.array([[0.0, 10.0, -20.0], [0.0, 10.0, -200.0]])
    rx = np.array([1000.0, 10.0, -30.0])
    there, back = RIDGE.path_loss_db(over(RIDGE, tx, rx)), RIDGE.path_loss_db(over(RIDGE, rx, tx))
    assert there.shape == (2,)
    assert there == pytest.approx(back, abs=1e-9)
    assert there[0] > there[1] + 10.0


def test_heights_between_grid_points():
    slope = Terrain(spacing_m=10.0, heights_m=((0.0, 10.0), (20.0, 30.0)))
    assert float(slope.height_m(np.asarray(5.0), np.asarray(5.0))) == pytest.approx(15.0)
    border = slope.model_copy(update={"outside": "border"})
    assert float(border.height_m(np.asarray(-99.0), np.asarray(99.0))) == 10.0
    with pytest.raises(OutsideValidityError, match=r"place \(north, east\) = \(-99.0, 99.0\)"):
        slope.height_m(np.asarray(-99.0), np.asarray(99.0))


def test_a_grid_that_is_none():
    with pytest.raises(ValidationError, match="rows of one length"):
        Terrain(spacing_m=1.0, heights_m=((1.0, 2.0), (3.0,)))
    with pytest.raises(ValidationError, match="spacing_m is missing"):
        Terrain(heights_m=((1.0, 2.0), (3.0, 4.0)))
    with pytest.raises(ValidationError, match="either heights_m or file"):
        Terrain(spacing_m=1.0)


ITU_HEIGHTS_M = ((30, 30), (50, 10), (20, 20), (40, 50), (70, 5))
ITU_FREQUENCIES_HZ = (1000e6, 2500e6, 600e6, 200e6, 150e6)
ITU_LOSSES_DB = {
    1: (32.84284766, 37.229036, 31.22595813, 24.87792613, 24.78223928),
    3: (17.62040631, 25.1016907, 20.25488733, 10.1899085, 16.27593106),
    4: (7.8709851352, 0.0, 15.30876397, 6.526730443, 0.0),
}
"""ITU-R study group 3, "Validation examples for the delta Bullington diffraction prediction method", column L_ba."""


@pytest.mark.parametrize("path", sorted(ITU_LOSSES_DB))
def test_bullington_of_the_worked_cases(path):
    """Three of the ITU's profiles, five links each, earth radius 8500 km; the ITU asks for 0.1 dB."""
    with (DATA / "itu_bullington_profiles.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if int(row["path"]) == path]
    along = np.array([float(row["distance_km"]) * 1e3 for row in rows])
    height = np.array([float(row["height_m"]) for row in rows])
    inner = along[1:-1]
    bulged = height[1:-1] + bulge_m(inner, along[-1:], 8500.0 / 6371.0)
    profile = Profile(along[-1:], inner[np.newaxis], bulged[np.newaxis], np.ones((1, inner.size), dtype=bool))
    for (tx, rx), frequency, expected in zip(
        ITU_HEIGHTS_M, ITU_FREQUENCIES_HZ, ITU_LOSSES_DB[path], strict=True
    ):
        ends = np.array([height[0] + tx]), np.array([height[-1] + rx])
        got = float(bullington_db(profile, *ends, 299_792_458.0 / frequency)[0])
        assert got == pytest.approx(expected, abs=0.1)


def test_two_ridges_cost_more_than_the_higher_one():
    one = [0.0] * 101
    one[40] = 60.0
    two = list(one)
    two[70] = 55.0
    ends = (0.0, 10.0, -20.0), (1000.0, 10.0, -20.0)
    losses = {}
    for name, heights in (("one", one), ("two", two)):
        grid = tuple((height,) * 3 for height in heights)
        for edges in ("worst", "bullington"):
            terrain = Terrain(spacing_m=10.0, step_m=1.0, heights_m=grid, edges=edges)
            losses[name, edges] = float(terrain.path_loss_db(over(terrain, *ends)))
    assert losses["two", "worst"] == pytest.approx(losses["one", "worst"], abs=1e-9)
    assert losses["two", "bullington"] > losses["one", "bullington"] + 1.0


def test_bullington_over_one_ridge_by_hand():
    """J = 25.40 dB for nu = 4.69 (40 m over the middle of 1 km, 2.412 GHz); + (1 - e^(-J/6)) (10 + 0.02) = 9.87 dB."""
    nu = 40.0 * np.sqrt(2.0 * 1000.0 / (0.124292 * 500.0 * 500.0)) * 1.0
    edge = 6.9 + 20.0 * np.log10(np.sqrt((nu - 0.1) ** 2 + 1.0) + nu - 0.1)
    terrain = RIDGE.model_copy(update={"edges": "bullington"})
    loss = float(terrain.path_loss_db(over(terrain, (0.0, 10.0, -20.0), (1000.0, 10.0, -20.0))))
    expected = float(friis_db(1000.0, 2.412e9)) + edge + (1.0 - np.exp(-edge / 6.0)) * 10.02
    assert loss == pytest.approx(expected, abs=0.05)


def test_flat_ground_has_the_horizon_in_it():
    """71 km of plain, 915 MHz, 40 m and 40 m: the edge of test_horizon, J = 12.07 dB, by Bullington's formula."""
    plain = {
        "model": "terrain",
        "spacing_m": 80e3,
        "origin_north_m": -1e3,
        "origin_east_m": -1e3,
        "step_m": 100.0,
    }
    radio = Radio(
        load_radio("perfect", {"frequency_hz": 915e6, "propagation": plain | {"heights_m": [[0.0, 0.0]] * 2}})
    )
    link = radio.link(71_000.0)
    assert "horizon_db" not in {term.name for term in link.terms}
    edge = 12.07
    diffraction = edge + (1.0 - np.exp(-edge / 6.0)) * (10.0 + 0.02 * 71.0)
    assert float(link.path_loss_db - friis_db(71_000.0, 915e6)) == pytest.approx(diffraction, abs=0.05)


def test_an_antenna_is_never_in_the_ground():
    hill = Terrain(spacing_m=1000.0, heights_m=((30.0, 30.0), (30.0, 30.0)), earth_radius_factor=None)
    low = over(hill, (0.0, 10.0, -1.0), (500.0, 10.0, -50.0))
    on_it = over(hill, (0.0, 10.0, -30.1), (500.0, 10.0, -50.0))
    assert float(hill.path_loss_db(low)) == pytest.approx(float(hill.path_loss_db(on_it)), abs=0.05)


def test_the_grid_is_made_once():
    terrain = Terrain(spacing_m=10.0, heights_m=((0.0, 10.0), (20.0, 30.0)))
    assert terrain._ground is terrain._ground
    assert Terrain.model_validate(terrain.model_dump()) == terrain


def test_in_a_valley_below_the_origin_angles_and_distances_are_those_of_the_places():
    """100 m apart and 100 m up are 45 degrees, wherever the origin is; K of a Rician law goes by them."""
    radio = Radio(load_radio("perfect"))
    for low_m in (5.0, -60.0):
        path = radio.path(
            position_tx_ned_m=(0.0, 0.0, -low_m), position_rx_ned_m=(100.0, 0.0, -low_m - 100.0)
        )
        assert float(path.elevation_deg) == pytest.approx(45.0)
        assert float(path.ground_distance_m) == pytest.approx(100.0)
