"""The bulge of the Earth, for every propagation law."""

import math

import numpy as np
import pytest

from channel.cli.sweep import reach
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.presets import load_radio


def bulge_db(ground_m, tx_m, rx_m, frequency_hz=915e6, **overrides):
    ends = {"ground_distance_m": ground_m, "height_tx_m": tx_m, "height_rx_m": rx_m}
    curved = Radio(load_radio("perfect", {"frequency_hz": frequency_hz, **overrides}))
    flat = Radio(
        load_radio("perfect", {"frequency_hz": frequency_hz, **overrides, "earth_radius_factor": None})
    )
    return flat.link(**ends).received_power_dbm - curved.link(**ends).received_power_dbm


@pytest.mark.parametrize(("tx_m", "rx_m"), [(40.0, 40.0), (10.0, 90.0), (120.0, 2.0)])
def test_a_grazing_ray_loses_6_db_at_4_12_km_times_the_roots_of_the_heights(tx_m, rx_m):
    """The textbook horizon with 4/3 earth, d = 4.12 (sqrt(h1) + sqrt(h2)) km."""
    horizon = 4122.0 * (math.sqrt(tx_m) + math.sqrt(rx_m))
    assert float(bulge_db(horizon, tx_m, rx_m, 24e9)) == pytest.approx(6.03, abs=0.15)
    assert float(bulge_db(0.8 * horizon, tx_m, rx_m, 24e9)) < 0.05
    assert float(bulge_db(1.1 * horizon, tx_m, rx_m, 24e9)) > 10.0


def test_bullingtons_edge_by_hand():
    """40 m and 40 m, 71 km, 915 MHz, k a = 8494.7 km.

    Horizon rays rise by D / 2a - 2 sqrt(h / 2a) = 4.179e-3 - 3.069e-3 = 1.110e-3 and meet 39.4 m over the line between
    the ends: nu = 39.4 sqrt(2 71000 / (0.3276 35500^2)) = 0.731, J = 12.07 dB.
    """
    assert float(bulge_db(71_000.0, 40.0, 40.0)) == pytest.approx(12.07, abs=0.03)


def test_it_grows_with_distance_without_a_step_and_both_ways_alike():
    distance = np.geomspace(100.0, 200e3, 4000)
    for tx_m, rx_m in ((0.2, 40.0), (40.0, 40.0), (1.5, 3.0)):
        loss = bulge_db(distance, tx_m, rx_m)
        assert np.all(np.diff(loss) > -1e-9)
        assert np.max(np.diff(loss)) < 0.2
        assert loss == pytest.approx(bulge_db(distance, rx_m, tx_m), abs=1e-9)
    assert np.all(bulge_db(np.linspace(1.0, 1500.0, 50), 40.0, 40.0) == 0.0)
    assert np.all(bulge_db(np.linspace(1.0, 1000.0, 50), 2.0, 0.2, 2.4e9) < 0.15)


def test_whoever_flies_higher_loses_less():
    heights = np.linspace(0.2, 200.0, 400)
    for distance in (5e3, 40e3, 120e3):
        assert np.all(np.diff(bulge_db(distance, heights, heights)) <= 1e-6)


def test_half_as_many_metres_without_refraction():
    """The geometric horizon, k = 1: 3.57 km times the roots."""
    horizon = 3570.0 * 2.0 * math.sqrt(40.0)
    assert float(bulge_db(horizon, 40.0, 40.0, 24e9, earth_radius_factor=1.0)) == pytest.approx(
        6.03, abs=0.15
    )


def test_every_law_has_it_and_the_budget_names_it():
    for model in ("free-space", "log-distance", "two-ray", "two-slope"):
        overrides = {"propagation": {"model": model}}
        assert float(bulge_db(80_000.0, 40.0, 40.0, **overrides)) == pytest.approx(
            float(bulge_db(80_000.0, 40.0, 40.0))
        )
    far = Radio(load_radio("perfect")).link(80_000.0)
    names = [term.name for term in far.terms]
    assert names[-2:] == ["horizon_db", "path_loss_db"]
    assert float(sum(term.contribution for term in far.terms)) == pytest.approx(float(far.received_power_dbm))


def test_telemetry_ends_near_its_horizon():
    """52 km between two aircraft at 40 m."""
    assert 30e3 < reach(load_radio("telemetry-915")).range_50_m < 55e3


def test_a_medium_has_it_too():
    changes = {
        "shadowing": {"model": "none"},
        "noise": {"model": "fixed", "floor_dbm": -330.0},
    }  # else nobody would look at its power
    radio = Radio(load_radio("corrected", changes))
    medium = Medium(radio, seed=1, nodes=["a", "b"])
    medium.place("a", (0.0, 0.0, -40.0))
    medium.place("b", (80_000.0, 0.0, -40.0))
    medium.send(medium.packets(tx="a", seq=0, length_bytes=40))
    assert medium.settle().received_power_dbm[0] == pytest.approx(
        float(radio.link(80_000.0).received_power_dbm), abs=6e-4
    )
