"""The law of one sensor's readings, against closed forms and scipy's distributions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError
from scipy import stats

from channel.sensing.sensor import Sensor
from tests.unit.channel.sensing.scenes import CARRIER_HZ, config, law_dbm

FLOOR_DBM = 10.0 * np.log10(1.380649e-23 * 290.0 * 200e3 * 1e3) + 8.0


def readings(averages: int, snr_db: float, count: int = 4000) -> np.ndarray:
    """Readings over the noise floor, as ratios."""
    sensor = Sensor(config(averages=averages))
    random = np.random.default_rng(5)
    signal_dbm = np.full(count, FLOOR_DBM + snr_db)
    reading_dbm = sensor.reading_dbm(signal_dbm, random.standard_normal(count), random.random(count))
    return np.asarray(10.0 ** ((reading_dbm - FLOOR_DBM) / 10.0))


@pytest.mark.parametrize("averages", [1, 7, 1000])
@pytest.mark.parametrize("snr_db", [-30.0, 0.0, 12.0])
def test_a_reading_is_a_noncentral_chi_square_variable(averages: int, snr_db: float) -> None:
    """Scipy's own distribution: 2M degrees of freedom, noncentrality 2M S / N."""
    found, snr = readings(averages, snr_db), 10.0 ** (snr_db / 10.0)
    law = stats.ncx2(2 * averages, 2 * averages * snr, scale=0.5 / averages)
    assert stats.kstest(found, law.cdf).pvalue > 1e-3
    assert found.mean() == pytest.approx(1.0 + snr, abs=4.0 * law.std() / np.sqrt(found.size))


def test_what_is_said_of_the_noise_is_what_it_does() -> None:
    sensor = Sensor(config(averages=1000))
    for snr_db in (-3.0, 5.0, 20.0):
        found_db = 10.0 * np.log10(readings(1000, snr_db)) + FLOOR_DBM
        assert float(sensor.noise_sigma_db(FLOOR_DBM + snr_db)) == pytest.approx(found_db.std(), rel=0.06)
        assert float(sensor.with_noise_dbm(FLOOR_DBM + snr_db)) == pytest.approx(found_db.mean(), abs=0.02)


def test_the_expected_power_is_the_closed_form_for_all_particles_at_once() -> None:
    sensor = Sensor(config())
    particles = np.array([[300.0, 0.0, 0.0], [0.0, 400.0, 0.0], [100.0, 0.0, -40.0]])
    found = sensor.expected_power_dbm(particles, [0.0, 0.0, -40.0], power_dbm=[20.0, 10.0, 0.0])
    distance_m = np.hypot(np.array([300.0, 400.0, 100.0]), [40.0, 40.0, 0.0])
    expected = law_dbm(distance_m, np.array([20.0, 10.0, 0.0]))
    assert found == pytest.approx(expected, abs=1e-9)
    other = sensor.expected_power_dbm(
        particles, [0.0, 0.0, -40.0], power_dbm=0.0, frequency_hz=2 * CARRIER_HZ
    )
    assert other - law_dbm(distance_m, 0.0) == pytest.approx(-20.0 * np.log10(2.0), abs=1e-9)


def test_the_receivers_ends_count_and_the_transmitters_do_not() -> None:
    changes = {
        "transmit_power_dbm": 33.0,
        "antenna": {"model": "isotropic", "gain_db": 7.0},
        "receive_antenna": {"model": "isotropic", "gain_db": 3.0},
        "cable_loss_db": 5.0,
        "receive_cable_loss_db": 1.5,
        "offset_db": -2.0,
    }
    found = Sensor(config(changes)).expected_power_dbm([100.0, 0, -40.0], [0, 0, -40.0], power_dbm=20.0)
    assert float(found) == pytest.approx(float(law_dbm(np.array(100.0))) + 3.0 - 1.5 - 2.0, abs=1e-9)


def test_what_is_known_of_the_law() -> None:
    sensor = Sensor(config({"shadowing": {"model": "gudmundson", "sigma_db": 4.0, "decorrelation_m": 30.0}}))
    assert (sensor.shadowing_sigma_db, sensor.decorrelation_m) == (4.0, 30.0)
    assert sensor.noise_floor_dbm == pytest.approx(FLOOR_DBM, abs=1e-9)
    assert sensor.threshold_dbm == pytest.approx(FLOOR_DBM + 3.0, abs=1e-3)
    assert sensor.band_hz == pytest.approx((433.82e6, 434.02e6))
    rayleigh = Sensor(config({"fading": {"model": "rayleigh"}}))
    # of a power that is exponential with mean 1, in dB: -10 gamma / ln 10, and 10 / ln 10 pi / sqrt 6
    assert rayleigh.fading_db == pytest.approx((-2.50682, 5.57000), abs=2e-3)
    none = Sensor(config({"fading": {"model": "none"}, "shadowing": {"model": "none"}}))
    assert (none.shadowing_sigma_db, none.decorrelation_m, none.fading_db) == (0.0, None, (0.0, 0.0))
    by_table = Sensor(config({"propagation": {"model": "uma-av"}, "shadowing": {"model": "normal"}}))
    assert math.isnan(by_table.shadowing_sigma_db)


@pytest.mark.parametrize("step_db", [0.001, 0.3, 0.5, 1.0])
def test_readings_are_told_in_whole_steps(step_db: float) -> None:
    reading_dbm = -np.random.default_rng(1).uniform(40.0, 120.0, 1000).round(3)
    found = Sensor(config(step_db=step_db)).told_dbm(reading_dbm)
    assert np.abs(found - reading_dbm).max() <= 0.5 * step_db + 1e-9
    steps = found / step_db
    assert steps == pytest.approx(np.rint(steps), abs=1e-6)


@pytest.mark.parametrize(
    "settings",
    [
        {"rate_hz": 0.0},
        {"averages": 0},
        {"step_db": 0.0},
        {"band_hz": (2.0, 1.0)},
        {"identifies": "colour"},
        {"rate": 3},
    ],
)
def test_settings_that_are_none(settings: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        config(**settings)


def test_noise_that_comes_by_the_antenna_comes_through_the_sensors_cable() -> None:
    """10 dB of cable: what is outside and far above the receiver's own noise sinks by as much, that does not."""
    outside = {
        "noise": {"model": "man-made", "environment": "city", "noise_figure_db": 3.0, "outside": "clamp"}
    }

    def floor_mw(cable_db: float) -> float:
        found_dbm = Sensor(config(outside | {"receive_cable_loss_db": cable_db})).noise_floor_dbm
        return float(10.0 ** (found_dbm / 10.0))

    thermal_mw = 1.380649e-23 * 290.0 * 200e3 * 1e3
    own_mw = 10.0**0.3 * thermal_mw
    assert floor_mw(10.0) - own_mw == pytest.approx((floor_mw(0.0) - own_mw) / 10.0, rel=1e-9)
