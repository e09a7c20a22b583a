import numpy as np
import pytest
from pydantic import ValidationError

from channel.link.radio import Radio
from channel.presets import load_radio
from channel.propagation.diffraction import knife_edge_loss_db
from channel.propagation.path_loss import friis_loss_db
from channel.propagation.terrain import Terrain

RIDGE = Terrain(
    spacing_m=10.0, step_m=1.0, heights_m=tuple((60.0 if i == 50 else 0.0,) * 3 for i in range(101))
)


def over(terrain, tx, rx):
    radio = Radio(load_radio("perfect"))
    return radio.path(position_tx_ned_m=tx, position_rx_ned_m=rx)


def test_knife_edge_values_of_the_standard():
    """ITU-R P.526, figure 9: 6 dB at grazing incidence, 0 at -0.78, 13 dB at 1, 19 dB at 2.4."""
    assert knife_edge_loss_db(np.array([-5.0, -0.78])) == pytest.approx([0.0, 0.0], abs=0.02)
    assert knife_edge_loss_db(np.array([0.0, 1.0, 2.4])) == pytest.approx([6.03, 13.9, 20.5], abs=0.1)


def test_a_ridge_blocks_the_sight_and_costs_what_its_edge_costs():
    path = over(RIDGE, (0.0, 10.0, -20.0), (1000.0, 10.0, -20.0))
    assert not RIDGE.line_of_sight(path)
    nu = 40.0 * np.sqrt(2.0 * 1000.0 / (0.124292 * 500.0 * 500.0))
    expected = friis_loss_db(1000.0, 2.412e9) + knife_edge_loss_db(nu)
    assert float(RIDGE.path_loss_db(path)) == pytest.approx(float(expected), abs=0.05)


def test_high_above_it_there_is_free_space():
    path = over(RIDGE, (0.0, 10.0, -200.0), (1000.0, 10.0, -200.0))
    assert RIDGE.line_of_sight(path)
    assert float(RIDGE.path_loss_db(path)) == pytest.approx(float(friis_loss_db(1000.0, 2.412e9)))


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
    assert float(slope.height_m(np.asarray(-99.0), np.asarray(99.0))) == 10.0


def test_a_grid_that_is_none():
    with pytest.raises(ValidationError, match="rows of one length"):
        Terrain(spacing_m=1.0, heights_m=((1.0, 2.0), (3.0,)))
