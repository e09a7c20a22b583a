"""Averages over fading and shadowing where the error rate jumps or bends: by closed forms and scipy's quadrature."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy import integrate, stats

from channel.cli.commands import main
from channel.link.radio import Radio
from channel.presets import load_radio

FADINGS: list[dict[str, Any]] = [
    {"model": "rayleigh"},
    {"model": "nakagami", "m": 3.0},
    {"model": "rician", "k_db": 6.0},
    {"model": "rician", "k_db": 25.0},
]
STEEP = ((5.9, 1.0), (6.0, 0.4), (6.02, 0.0))
ERRORS: list[dict[str, Any]] = [
    {"model": "threshold", "snr_min_db": 6.003},
    {"model": "snr-table", "table": STEEP, "reference_length_bytes": 40},
]
DISTANCES_M = np.linspace(100.0, 1200.0, 500)


def law(fading: dict[str, Any]) -> Any:
    """The distribution of the power gain, mean 1."""
    if fading["model"] == "rayleigh":
        return stats.expon()
    if fading["model"] == "nakagami":
        return stats.gamma(fading["m"], scale=1.0 / fading["m"])
    k = 10.0 ** (fading["k_db"] / 10.0)
    return stats.ncx2(2, 2.0 * k, scale=0.5 / (k + 1.0))


def ratio(db: Any) -> Any:
    return 10.0 ** (np.asarray(db) / 10.0)


def faded(fading: dict[str, Any], error: dict[str, Any], **more: Any) -> Radio:
    own = {"shadowing": {"model": "none"}, "propagation": {"model": "log-distance", "exponent": 3.0}}
    return Radio(load_radio("corrected", own | {"fading": fading, "error": error} | more))


@pytest.mark.parametrize("fading", FADINGS)
def test_a_threshold_over_fading_is_the_laws_tail(fading: dict[str, Any]) -> None:
    """At all distances, within the bound that is said, which is small; and from the table."""
    radio = faded(fading, ERRORS[0])
    delivery = radio.delivery(DISTANCES_M)
    snr_db = np.asarray(radio.link(DISTANCES_M).snr_db)
    expected = law(fading).sf(ratio(6.003 - snr_db))
    assert np.all(np.abs(delivery.probability - expected) <= delivery.error_bound + 1e-12)
    assert delivery.error_bound.max() < 1e-8
    assert radio.expected_delivery(DISTANCES_M) == pytest.approx(expected, abs=2e-4)
    if fading != FADINGS[-1]:  # as steep as a gain that hardly varies; the table's step is 0.02 dB
        assert radio.expected_delivery(DISTANCES_M) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("fading", FADINGS)
def test_a_steep_table_over_fading(fading: dict[str, Any]) -> None:
    """By scipy's quadrature from row to row."""
    radio = faded(fading, ERRORS[1])
    at_m = DISTANCES_M[::20]
    snr_db = np.asarray(radio.link(at_m).snr_db)
    gain, (rows_db, per) = law(fading), np.array(STEEP).T

    def expected(mean_db: float) -> float:
        total = float(gain.sf(ratio(rows_db[-1] - mean_db)))
        for low, high in pairwise(rows_db):
            borders = ratio([low - mean_db, high - mean_db])

            def success(g: float) -> float:
                return float((1.0 - np.interp(10.0 * np.log10(g) + mean_db, rows_db, per)) * gain.pdf(g))

            total += integrate.quad(success, *borders, epsabs=1e-12)[0]
        return total

    by_quad = np.array([expected(each) for each in snr_db.tolist()])
    delivery = radio.delivery(at_m)
    assert np.all(np.abs(delivery.probability - by_quad) <= delivery.error_bound + 1e-9)
    assert delivery.error_bound.max() < 1e-7
    assert radio.expected_delivery(at_m) == pytest.approx(by_quad, abs=2e-4)


@pytest.mark.parametrize("fading", FADINGS)
@pytest.mark.parametrize("sigma_db", [1.0, 4.0])
def test_a_threshold_over_fading_and_shadowing(fading: dict[str, Any], sigma_db: float) -> None:
    """The law's tail, averaged over 4001 losses."""
    radio = faded(fading, ERRORS[0], shadowing={"model": "normal", "sigma_db": sigma_db})
    at_m = DISTANCES_M[::10]
    delivery = radio.delivery(at_m)
    z = np.linspace(-8.3, 8.3, 4001)
    tails = law(fading).sf(ratio(6.003 - np.asarray(radio.link(at_m).snr_db)[:, np.newaxis] + sigma_db * z))
    expected = np.average(tails, axis=1, weights=stats.norm.pdf(z))
    assert np.all(np.abs(delivery.probability - expected) <= delivery.error_bound + 1e-9)
    assert delivery.error_bound.max() < 3e-3


def test_what_a_radio_file_with_a_threshold_delivers_at_231_m(tmp_path: Path) -> None:
    """exp(-6 dB over the SNR), as `link` prints it."""
    file = tmp_path / "radio.yaml"
    file.write_text(
        "preset: corrected\nerror: {model: threshold, snr_min_db: 6}\nshadowing: {model: none}\n"
        "fading: {model: rayleigh}\npropagation: {exponent: 3}\n"
    )
    options = ["link", "--ground-distance", "231", "--radio", str(file), "--json"]
    report = json.loads(CliRunner().invoke(main, options, catch_exceptions=False).output)
    expected = float(np.exp(-ratio(6.0 - report["snr_db"])))
    assert report["probability_of_delivery"] == pytest.approx(expected, abs=1e-4)


def test_links_of_any_shape_with_a_drawn_line_of_sight() -> None:
    """One link, and a table of them, are as each by itself by quadrature."""
    radio = Radio(load_radio("lte-like"))
    distances_m = np.array([[600.0, 5000.0, 7000.0], [8000.0, 9000.0, 9900.0]])
    table = radio.expected_delivery(distances_m, height_tx_m=30.0, height_rx_m=30.0)
    assert table == pytest.approx(
        radio.probability_of_delivery(distances_m, height_tx_m=30.0, height_rx_m=30.0), abs=2e-5
    )
    for at_m, chance in zip(distances_m.ravel().tolist(), table.ravel().tolist(), strict=True):
        one = radio.expected_delivery(at_m, height_tx_m=30.0, height_rx_m=30.0)
        assert np.shape(one) == ()
        assert float(one) == pytest.approx(chance, abs=1e-12)
