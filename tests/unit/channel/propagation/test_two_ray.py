"""Two rays and the horizon against numbers worked out by hand."""

import cmath
import math

import numpy as np
import pytest

from channel.link.radio import Radio
from channel.presets import load_radio
from channel.propagation.path_loss import friis_db
from channel.propagation.two_ray import TwoRay, TwoSlope

C = 299_792_458.0
DRY = {"ground_permittivity": 15.0, "ground_conductivity_s_per_m": 0.0}


def radio(propagation, **more):
    tree = {"propagation": propagation, "earth_radius_factor": None, "min_distance_m": 1e-3}
    return Radio(load_radio("perfect", tree | more))


def over_free_space_db(model, ground_m, tx_m=40.0, rx_m=40.0, frequency_hz=2.4e9):
    """What the ground adds, dB."""
    path = radio({"model": "free-space"}).path(
        ground_distance_m=ground_m, height_tx_m=tx_m, height_rx_m=rx_m, frequency_hz=frequency_hz
    )
    return friis_db(path.distance_m, frequency_hz) - model.path_loss_db(path)


def test_nulls_and_peaks_are_where_the_ways_differ_by_whole_and_half_wavelengths():
    """40 m, 40 m, 2.4 GHz: r - d = n lambda at d = (4 h1 h2 / (n lambda) - n lambda) / 2, by hand.

    n = 10: 2561.1 m; n = 9.5: 2696.0 m; n = 9: 2845.8 m. With eps 15, horizontal, at 2561.1 m: sin psi = 80 / 2562.4,
    G = (0.03122 - 3.74179) / (0.03122 + 3.74179) = -0.98345, d/r = 0.99951: 20 log(1 - 0.98297) = -35.4 dB.
    """
    model = TwoRay(polarisation="horizontal", **DRY)
    distance = np.arange(2500.0, 2900.0, 0.05)
    gain = over_free_space_db(model, distance)
    first, second = distance < 2700.0, distance > 2700.0
    assert distance[first][np.argmin(gain[first])] == pytest.approx(2561.1, abs=0.2)
    assert distance[second][np.argmin(gain[second])] == pytest.approx(2845.8, abs=0.2)
    between = (distance > 2600.0) & (distance < 2800.0)
    assert distance[between][np.argmax(gain[between])] == pytest.approx(2696.0, abs=0.5)
    assert float(over_free_space_db(model, 2561.1)) == pytest.approx(-35.4, abs=0.1)
    assert np.max(gain) == pytest.approx(20.0 * math.log10(1.0 + 0.983), abs=0.01)


def test_vertical_antennas_see_nothing_reflected_at_brewsters_angle():
    """tan psi = 1 / sqrt(eps): over eps 15 at a grazing angle of 14.48 degrees, heights 40 m 309.8 m apart."""
    apart = 80.0 * math.sqrt(15.0)
    assert float(over_free_space_db(TwoRay(**DRY), apart)) == pytest.approx(0.0, abs=1e-6)
    assert abs(TwoRay(**DRY).reflection(np.asarray(math.sin(math.atan(15.0**-0.5))), 2.4e9)) < 1e-12


def test_far_away_it_is_the_fourth_power_law():
    """h1^2 h2^2 / d^4 (Rappaport, eq. 4.52), at thirty times the crossover; and free space over rough ground."""
    model = TwoRay(polarisation="horizontal", ground_permittivity=80.0, ground_conductivity_s_per_m=4.0)
    crossover = 4.0 * math.pi * 2.0 * 2.0 * 915e6 / C
    far = 30.0 * crossover
    got = friis_db(far, 915e6) - over_free_space_db(model, far, 2.0, 2.0, 915e6)
    assert float(got) == pytest.approx(40.0 * math.log10(far) - 20.0 * math.log10(4.0), abs=0.15)
    rough = TwoRay(roughness_m=5.0, **DRY)
    assert over_free_space_db(rough, np.linspace(50.0, 300.0, 9)) == pytest.approx(0.0, abs=1e-3)


def test_roughness_takes_what_ament_says():
    """s = 0.1 m, sin psi = 0.1, 2.4 GHz: rho = exp(-8 (pi 0.01 / 0.124914)^2) = exp(-0.50602) = 0.6029."""
    smooth, rough = TwoRay(**DRY), TwoRay(roughness_m=0.1, **DRY)
    sine = np.asarray(0.1)
    assert abs(rough.reflection(sine, 2.4e9) / smooth.reflection(sine, 2.4e9)) == pytest.approx(
        0.6029, abs=1e-4
    )


def test_the_spread_between_aircraft_is_tens_of_decibels():
    gain = over_free_space_db(TwoRay(polarisation="horizontal"), np.linspace(100.0, 3000.0, 20_000))
    low, high = np.percentile(gain, [1.0, 99.0])
    assert low < -20.0
    assert 5.0 < high < 6.02


def test_antennas_weigh_each_ray_by_its_own_direction():
    """Dipoles upright at 40 m, 80 m apart: the reflected ray leaves at 45 degrees, 4.04 dB below a dipole's best.

    cos(pi/2 cos 45) / sin 45 = 0.62793 for each antenna: the reflected amplitude is 0.62793^2 of the isotropic one.
    """
    dipole = {"model": "dipole", "null_depth_db": 100.0}
    link = radio({"model": "two-ray", **DRY}, antenna=dipole, frequency_hz=2.4e9).link(
        ground_distance_m=80.0, height_tx_m=40.0, height_rx_m=40.0
    )
    sine, root = math.sqrt(0.5), math.sqrt(15.0 - 0.5)
    ground = (15.0 * sine - root) / (15.0 * sine + root)
    amplitude = math.cos(math.pi / 2.0 * sine) / sine
    longer = 80.0 * (math.sqrt(2.0) - 1.0)
    both = 1.0 + ground * amplitude**2 / math.sqrt(2.0) * cmath.exp(-2j * math.pi * longer * 2.4e9 / C)
    free = 20.0 * math.log10(4.0 * math.pi * 80.0 * 2.4e9 / C)
    assert amplitude == pytest.approx(0.62793, abs=1e-5)
    assert float(link.path_loss_db) == pytest.approx(free - 20.0 * math.log10(abs(both)), abs=1e-6)


def test_a_bank_turns_the_reflection_on():
    """Level dipoles straight above each other's image hear no reflection; banked by 90 degrees they do."""
    aircraft = radio({"model": "two-ray"}, antenna={"model": "dipole"}, polarisation=None)
    ends = {"position_tx_ned_m": (0.0, 0.0, -60.0), "position_rx_ned_m": (5.0, 0.0, -60.0)}
    banked = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
    level = aircraft.link(**ends)
    rolled = aircraft.link(**ends, attitude_tx_wxyz=banked, attitude_rx_wxyz=banked)
    free = float(friis_db(5.0, 2.412e9))
    assert float(level.path_loss_db) == pytest.approx(free, abs=0.01)
    assert abs(float(rolled.path_loss_db) - free) > 0.05


def test_the_two_slopes_meet_at_the_crossover():
    crossover = 4.0 * math.pi * 10.0 * 2.0 * 915e6 / C
    path = radio({"model": "two-slope"}).path(
        crossover * np.array([0.5, 1.0, 2.0]), height_tx_m=10.0, height_rx_m=2.0
    )
    loss = TwoSlope().path_loss_db(path._replace(frequency_hz=915e6))
    assert np.diff(loss) == pytest.approx([20.0 * math.log10(2.0), 40.0 * math.log10(2.0)], abs=1e-3)
