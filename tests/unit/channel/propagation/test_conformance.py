"""Against values that ns-3 3.37 computed (tests/data), within the tolerances that we promise."""

import numpy as np
import pytest

from benchmarks.channel.bench_oracles import error_rates, path_losses
from channel import presets
from channel.geometry import Path
from channel.link.radio import Radio
from channel.propagation.hata import Cost231Hata, OkumuraHata
from channel.propagation.path_loss import friis_db


def test_path_losses_are_those_of_ns3():
    found = path_losses()
    assert len(found) == 12
    assert sum(differences.size for differences in found.values()) == 135
    for law, differences in found.items():
        assert differences == pytest.approx(0.0, abs=1e-6), law


def test_error_rates_are_those_of_ns3():
    found = error_rates()
    assert sum(differences.size for differences in found.values()) == 348
    for mode, differences in found.items():
        assert differences == pytest.approx(0.0, abs=1e-9), mode


def test_okumura_hata_of_the_textbook():
    path = Path(900e6, np.asarray(1000.0), 30.0, 1.5)
    assert float(OkumuraHata().path_loss_db(path)) == pytest.approx(126.40, abs=0.005)


def test_textbook_coefficients_differ_where_they_are_said_to():
    path = Path(1800e6, np.asarray(2000.0), 30.0, 1.5)
    ns3 = Cost231Hata(city="large", coefficients="ns3").path_loss_db(path)
    textbook = Cost231Hata(city="large").path_loss_db(path)
    assert float(textbook - ns3) == pytest.approx(4.97)
    path = Path(900e6, np.asarray(2000.0), 30.0, 1.5)
    by_hata = OkumuraHata(environment="open").path_loss_db(path)
    urban = OkumuraHata(environment="urban").path_loss_db(path)
    log_f = np.log10(900.0)
    assert float(urban - by_hata) == pytest.approx(4.78 * log_f**2 - 18.33 * log_f + 40.94)
    by_ns3 = OkumuraHata(environment="open", coefficients="ns3").path_loss_db(path)
    assert float(by_ns3 - by_hata) == pytest.approx(0.08 * log_f**2)


@pytest.mark.parametrize(
    ("model", "frequency_hz", "by_hand_db"),
    [
        (OkumuraHata(), 900e6, 126.42 - 0.02),  # 69.55 + 77.28 - 20.41 - 0.02
        (OkumuraHata(city="large"), 900e6, 126.42),  # a = 3.2 * 1.24616^2 - 4.97 = 0.00
        (OkumuraHata(environment="suburban"), 900e6, 126.40 - 2.0 * 1.50708**2 - 5.4),
        (OkumuraHata(environment="open"), 900e6, 126.40 - 4.78 * 2.95424**2 + 18.33 * 2.95424 - 40.94),
        (Cost231Hata(), 1800e6, 136.24 - 0.04),  # 46.3 + 110.35 - 20.41 - 0.04
        (Cost231Hata(city="large"), 1800e6, 136.24 + 3.0),
    ],
)
def test_the_printed_formulas_at_1_km(model, frequency_hz, by_hand_db):
    """Hata 1980, eq. 10 to 17, and COST 231, eq. 4.4.3, by hand at 30 m and 1.5 m: the distance term is 0."""
    path = Path(frequency_hz, np.asarray(1000.0), 30.0, 1.5)
    assert float(model.path_loss_db(path)) == pytest.approx(by_hand_db, abs=0.02)


@pytest.mark.parametrize(
    ("exponent", "distance_m", "power_dbm"),
    [(6, 1, -20.531), (6, 3, -49.158), (12, 3, -77.786), (6, 100, -140.531)],
)
def test_gazebo_classic(exponent, distance_m, power_dbm):
    config = presets.load_radio("gazebo-classic", {"propagation": {"exponent": exponent}})
    assert float(Radio(config).link(distance_m).received_power_dbm) == pytest.approx(power_dbm, abs=6e-4)


def test_gz_means():
    default = Radio(presets.load_radio("gz-rfcomms"))
    assert float(default.link(50.0).snr_db) == pytest.approx(34.526, abs=6e-4)
    world = {"transmit_power_dbm": 20, "propagation": {"exponent": 2.6}, "max_range_m": 500000}
    link = Radio(presets.load_radio("gz-rfcomms", world)).link(52.0)
    assert float(link.received_power_dbm) == pytest.approx(-64.616, abs=6e-4)
    assert float(link.snr_db) == pytest.approx(25.384, abs=6e-4)


def test_friis_of_the_standard():
    """ITU-R P.525: 32.4 + 20 log10 f(MHz) + 20 log10 d(km), which rounds 32.448."""
    assert float(friis_db(1000.0, 2412e6)) == pytest.approx(32.448 + 20 * np.log10(2412.0), abs=1e-3)
