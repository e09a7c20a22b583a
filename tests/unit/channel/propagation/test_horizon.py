"""The bulge of the Earth, for every propagation law; the oracle is ITU-R P.526-15 in its practical units."""

import math

import numpy as np
import pytest

from channel.cli.sweep import reach
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.presets import load_radio

RADIUS_KM = 4.0 / 3.0 * 6371.0


def bulge_db(ground_m, tx_m, rx_m, frequency_hz=915e6, **overrides):
    ends = {"ground_distance_m": ground_m, "height_tx_m": tx_m, "height_rx_m": rx_m}
    curved = Radio(load_radio("perfect", {"frequency_hz": frequency_hz, **overrides}))
    flat = Radio(
        load_radio("perfect", {"frequency_hz": frequency_hz, **overrides, "earth_radius_factor": None})
    )
    return flat.link(**ends).received_power_dbm - curved.link(**ends).received_power_dbm


def height_gain_db(height_m, f_mhz, radius_km):
    """Eq. 15a, 18 and 18a, with beta = 1."""
    y = 9.575e-3 * f_mhz ** (2 / 3) * radius_km ** (-1 / 3) * height_m
    if y > 2.0:
        return 17.6 * math.sqrt(y - 1.1) - 5.0 * math.log10(y - 1.1) - 8.0
    return 20.0 * math.log10(y + 0.1 * y**3)


def p526_db(d_km, tx_m, rx_m, f_mhz, radius_km=RADIUS_KM):
    """Sec. 3.1.1, eq. 13, 14a and 17, antennas well above the ground."""
    x = 2.188 * f_mhz ** (1 / 3) * radius_km ** (-2 / 3) * d_km
    far = 11.0 + 10.0 * math.log10(x) - 17.6 * x
    near = -20.0 * math.log10(x) - 5.6488 * x**1.425
    gains = [height_gain_db(height, f_mhz, radius_km) for height in (tx_m, rx_m)]
    return -(far if x >= 1.6 else near) - sum(gains)


def horizon_km(tx_m, rx_m):
    return math.sqrt(2.0 * RADIUS_KM * 1e-3) * (math.sqrt(tx_m) + math.sqrt(rx_m))


def test_the_numbers_that_one_knife_edge_missed():
    """14.5 dB at the horizon (2.4 GHz), 16.9 dB at 52.1 km (915 MHz), both ends at 40 m; an edge has 6 dB."""
    horizon_m = 1e3 * horizon_km(40.0, 40.0)
    assert float(bulge_db(horizon_m, 40.0, 40.0, 2.4e9)) == pytest.approx(14.5, abs=0.05)
    assert float(bulge_db(horizon_m, 40.0, 40.0, 915e6)) == pytest.approx(16.9, abs=0.05)


@pytest.mark.parametrize("f_hz", [433e6, 915e6, 2.4e9, 5.8e9])
@pytest.mark.parametrize(("tx_m", "rx_m"), [(40.0, 40.0), (10.0, 90.0), (120.0, 5.0)])
def test_at_the_horizon_and_beyond_it_is_that_of_p526(f_hz, tx_m, rx_m):
    for share in (1.001, 1.1, 1.5):
        d_km = share * horizon_km(tx_m, rx_m)
        by_hand = p526_db(d_km, tx_m, rx_m, f_hz / 1e6)
        assert float(bulge_db(1e3 * d_km, tx_m, rx_m, f_hz)) == pytest.approx(by_hand, abs=0.1)


@pytest.mark.parametrize("share", [0.6, 0.8, 0.9, 0.98])
def test_inside_the_horizon_it_is_interpolated_by_the_clearance(share):
    """Sec. 3.2, both ends at 60 m, 5.8 GHz: the least clearance is in the middle, over a flat Earth there is enough."""
    d_km, wave_m = share * horizon_km(60.0, 60.0), 299.792458 / 5800.0
    clearance_m = 60.0 - 1e3 * d_km**2 / (8.0 * RADIUS_KM)
    enough_m = 0.552 * math.sqrt(1e3 * d_km * wave_m / 4.0)
    small_km = 0.5 * (d_km / (2.0 * math.sqrt(0.06))) ** 2
    by_hand = max(1.0 - clearance_m / enough_m, 0.0) * p526_db(d_km, 60.0, 60.0, 5800.0, small_km)
    assert enough_m < 60.0
    assert float(bulge_db(1e3 * d_km, 60.0, 60.0, 5.8e9)) == pytest.approx(by_hand, abs=0.05)


def test_two_rays_over_flat_ground_give_way_to_the_sphere():
    """A mast of 2 m and a UA at 40 m: at the horizon and beyond free space and P.526, no rays."""
    d_m = 1e3 * horizon_km(40.0, 2.0) * np.array([1.001, 1.2])
    radio = Radio(load_radio("perfect", {"frequency_hz": 915e6, "propagation": {"model": "two-ray"}}))
    link = radio.link(ground_distance_m=d_m, height_tx_m=40.0, height_rx_m=2.0)
    free_db = 20.0 * np.log10(4.0 * np.pi * np.hypot(d_m, 38.0) * 915e6 / 299_792_458.0)
    by_hand = [
        18.0 + 4.6 - free - p526_db(d / 1e3, 40.0, 2.0, 915.0) for free, d in zip(free_db, d_m, strict=True)
    ]
    assert link.received_power_dbm == pytest.approx(by_hand, abs=0.1)


def test_it_grows_with_distance_without_a_step_and_both_ways_alike():
    distance = np.geomspace(100.0, 200e3, 4000)
    for tx_m, rx_m in ((0.2, 40.0), (40.0, 40.0), (1.5, 3.0)):
        loss = bulge_db(distance, tx_m, rx_m)
        assert np.all(np.diff(loss) > -1e-9)
        assert np.max(np.diff(loss)) < 0.4
        assert loss == pytest.approx(bulge_db(distance, rx_m, tx_m), abs=1e-9)
    assert np.all(bulge_db(np.linspace(1.0, 1500.0, 50), 40.0, 40.0) == 0.0)
    assert np.all(bulge_db(np.linspace(1.0, 600.0, 50), 2.0, 0.2, 2.4e9) < 0.3)


def test_whoever_flies_higher_loses_less():
    heights = np.linspace(0.2, 200.0, 400)
    for distance in (5e3, 40e3, 120e3):
        assert np.all(np.diff(bulge_db(distance, heights, heights)) <= 1e-6)


def test_half_as_many_metres_without_refraction():
    """The geometric horizon, k = 1: P.526 with a = 6371 km."""
    d_km = 1.01 * math.sqrt(2.0 * 6.371) * 2.0 * math.sqrt(40.0)
    by_hand = p526_db(d_km, 40.0, 40.0, 5800.0, 6371.0)
    found = bulge_db(1e3 * d_km, 40.0, 40.0, 5.8e9, earth_radius_factor=1.0)
    assert float(found) == pytest.approx(by_hand, abs=0.1)


def test_the_budget_names_it():
    far = Radio(load_radio("perfect")).link(80_000.0)
    names = [term.name for term in far.terms]
    assert names[-2:] == ["horizon_db", "path_loss_db"]
    assert float(sum(term.contribution for term in far.terms)) == pytest.approx(float(far.received_power_dbm))
    log_distance = {"propagation": {"model": "log-distance"}}
    assert float(bulge_db(80e3, 40.0, 40.0, **log_distance)) == pytest.approx(
        float(bulge_db(80e3, 40.0, 40.0))
    )


def test_telemetry_ends_before_its_horizon():
    """52 km between two aircraft at 40 m."""
    assert 25e3 < reach(load_radio("telemetry-915")).range_50_m < 52e3


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
