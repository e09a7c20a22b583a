"""Fits of logs with Rician fading; the logs are drawn with numpy alone: shadowing by the way, Jakes, QPSK."""

import struct
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.channel.correlated_logs import FADED, Truth, drawn
from channel.cli.commands import main as channel
from channel.fit.calibration import fit_radio, fitted_radio
from channel.fit.correlated.faded import FadedOutcomes, gain_density
from channel.fit.correlated.law import Law
from channel.fit.flight_log import FlightLog
from channel.phy.error_model import Band
from channel.presets import load_radio

STRONG, WEAK = FADED["Rice, K 12 dB, to 1.2 km"], FADED["Rice, K 6 dB, to 1.2 km"]
ERRING = Truth(25.0, 2.6, 0.0, 5.0, 0.05, -94.0, error_db=1.5)


def log_of(truth, seed, packets=1200):
    distance_m, delivered, rssi_dbm = drawn(truth, packets, seed)
    return FlightLog(distance_m, delivered, np.full(packets, 40.0), rssi_dbm)


def by_name(fit):
    return {each.name: each for each in fit.estimates}


def held(fit, truth):
    """Return the parameters whose intervals hold the truth, or that the fit says nothing of."""
    found = by_name(fit)
    ends = {name: (found[name].low, found[name].high) for name in found}
    return [
        name
        for name, value in truth.by_name.items()
        if ends.get(name, (-np.inf, np.inf))[0] <= value <= ends.get(name, (-np.inf, np.inf))[1]
    ]


@pytest.fixture(scope="module")
def fits():
    return [
        (truth, fit_radio(log_of(truth, (8, 1), 700), load_radio("corrected"))) for truth in (STRONG, WEAK)
    ]


@pytest.mark.slow
def test_fading_is_found_and_the_floor_beside_it(fits):
    """Twelve dB of K in 700 packets are hardly told from readings that err: then the intervals hold both."""
    for truth, fit in fits:
        assert {"noise.floor_dbm", "base_loss"} <= set(held(fit, truth))
        assert by_name(fit)["noise.floor_dbm"].high - by_name(fit)["noise.floor_dbm"].low < 3.0
    assert "tell fading from readings" in by_name(fits[0][1])["noise.floor_dbm"].note
    truth, fit = fits[1]
    assert fit.rssi_error_db is None
    assert len(held(fit, truth)) >= 6
    assert by_name(fit)["fading.k_db"].value == pytest.approx(truth.k_db, abs=2.5)


@pytest.mark.slow
def test_the_written_radio_fades(fits):
    radio = fitted_radio(fits[1][1], load_radio("corrected"), "mine")
    assert radio.fading.model == "rician"
    assert radio.fading.coherence == "doppler"
    assert radio.fading.k_db == pytest.approx(by_name(fits[1][1])["fading.k_db"].value, abs=0.5)


@pytest.mark.slow
def test_readings_that_err_are_no_fading():
    fit = fit_radio(log_of(ERRING, (8, 2), 1000), load_radio("corrected"))
    assert "fading.k_db" not in by_name(fit)
    assert fit.rssi_error_db == pytest.approx(1.5, abs=0.3)
    assert "noise.floor_dbm" in held(fit, ERRING)


def test_the_tables_are_the_averages_of_a_sample():
    """Against draws of fading and of the place's SNR: what a loss, an arrival and a reading say."""
    base, k = load_radio("corrected"), 10.0**0.6
    band, rng = Band(base.bandwidth_hz, base.bit_rate_bps), np.random.Generator(np.random.PCG64(3))
    x, y = rng.normal(0.0, np.sqrt(0.5), (2, 200_000))
    gain_db = 10.0 * np.log10(((np.sqrt(k) + x) ** 2 + y**2) / (1.0 + k))
    delivered, rssi_dbm = np.array([False, False, True, True]), np.array([np.nan, np.nan, np.nan, -88.0])
    outcomes = FadedOutcomes(
        base.error, band, [40.0], np.zeros(4, dtype=int), delivered, rssi_dbm, step_variance=1e-4
    )
    snr_db, variance = np.array([4.0, 9.0, 8.0, 7.0]), np.array([0.0, 9.0, 4.0, 2.0])
    said = outcomes.said(snr_db, variance, Law(5.0, 30.0, float(np.std(gain_db)), -95.0, 0.05))
    places = snr_db[:, None] + np.sqrt(variance)[:, None] * rng.standard_normal(gain_db.size)
    arrives = 0.95 * (1.0 - base.error.per(places[:3] + gain_db, 40.0, band))
    read = 0.95 * (1.0 - float(base.error.per(7.0, 40.0, band))) * gain_density(7.0 - places[3], 6.0)
    expected = [1.0 - arrives[0], 1.0 - arrives[1], arrives[2], read * np.sqrt(2.0 * np.pi)]
    assert said.log == pytest.approx(np.log([np.mean(each) for each in expected]), abs=0.03)


def test_a_log_says_what_it_lacks_and_a_radio_is_asked_for(tmp_path):
    file = tmp_path / "flight.csv"
    file.write_text("distance_m,rssi_dbm\n100,-80\n")
    asked = CliRunner().invoke(channel, ["fit", str(file)])
    assert asked.exit_code == 2
    assert "--radio is missing: the radio to start from" in asked.output
    lacking = CliRunner().invoke(channel, ["fit", str(file), "--radio", "corrected"])
    assert lacking.exit_code == 2
    assert "flight.csv: has no column delivered (1 or 0), nor fate" in lacking.output


@pytest.mark.parametrize(("readings", "height_px"), [(True, 900), (False, 504)])
def test_the_plot_has_a_panel_for_readings(readings, height_px, tmp_path):
    from channel.cli.plots import plot_fit

    log = log_of(STRONG, (8, 3), 60)
    log = log if readings else replace(log, rssi_dbm=np.full(60, np.nan))
    radio = load_radio("corrected", {"length": {"model": "payload", "overhead_bytes": 500}})
    plot_fit(log, radio, tmp_path / "fit.png")
    assert struct.unpack(">II", (tmp_path / "fit.png").read_bytes()[16:24])[1] == height_px


def test_the_plotted_curve_takes_lengths_as_the_model_counts_them(tmp_path, monkeypatch):
    from channel.cli import plots

    asked = []

    def curve(self, distance_m, length_bytes):
        asked.append(self.length_bytes(length_bytes))
        return np.zeros_like(distance_m)

    monkeypatch.setattr(plots.Radio, "probability_of_delivery", curve)
    radio = load_radio("corrected", {"length": {"model": "payload", "overhead_bytes": 500}})
    plots.plot_fit(log_of(STRONG, (8, 3), 60), radio, tmp_path / "fit.png")
    assert asked == [40]


def coverage_of(truth, repeats, seed):
    """Return by parameter how many intervals of logs hold the truth."""
    fits = [fit_radio(log_of(truth, (seed, repeat)), load_radio("corrected")) for repeat in range(repeats)]
    return {name: sum(name in held(fit, truth) for fit in fits) for name in truth.by_name}


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.timeout(3000)
@pytest.mark.parametrize("truth", [STRONG, WEAK], ids=["K 12 dB", "K 6 dB"])
def test_intervals_of_a_hundred_logs_hold_the_truth(truth):
    counts = coverage_of(truth, 100, 10)
    assert min(counts.values()) >= 88, counts
