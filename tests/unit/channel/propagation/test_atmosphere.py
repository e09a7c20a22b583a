import builtins
import importlib.util
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from channel import presets
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.presets import PresetError
from channel.propagation import atmosphere
from channel.validity import OutsideValidityError
from tests.unit.channel.medium.one_by_one import rows

ITUR = importlib.util.find_spec("itur") is not None
needs_itur = pytest.mark.skipif(not ITUR, reason="needs itur: pip install 'lostlink[itur]' (280 MB)")
RAIN = {"frequency_hz": 28e9, "atmosphere": {"model": "itu-r", "rain_mm_h": 50.0}}


def test_without_the_library_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "itur", None)
    with pytest.raises(PresetError, match=r"atmosphere: .*lostlink\[itur\]"):
        presets.load_radio("corrected", {"atmosphere": {"model": "itu-r"}})


def test_a_radio_without_atmosphere_never_asks_for_the_library(monkeypatch):
    asked = []
    real = builtins.__import__
    monkeypatch.setattr(
        builtins, "__import__", lambda name, *rest, **more: asked.append(name) or real(name, *rest, **more)
    )
    Radio(presets.load_radio("corrected")).link(100.0)
    assert not [name for name in asked if name.startswith("itur")]


@pytest.fixture
def in_place_of_itur(monkeypatch):
    """Two functions of the library with made-up laws: what we do with its numbers is tested without it."""
    gases = SimpleNamespace(gamma_exact=lambda ghz, p, rho, t: SimpleNamespace(value=ghz * p * rho / t))
    rain = SimpleNamespace(
        rain_specific_attenuation=lambda rate, ghz, elevation, tilt: SimpleNamespace(value=rate * tilt / ghz)
    )
    for name, module in {
        "": object(),
        ".models": object(),
        ".models.itu676": gases,
        ".models.itu838": rain,
    }.items():
        monkeypatch.setitem(sys.modules, f"itur{name}", module)
    atmosphere._gas_db_per_km.cache_clear()
    atmosphere._rain_db_per_km.cache_clear()
    yield
    atmosphere._gas_db_per_km.cache_clear()
    atmosphere._rain_db_per_km.cache_clear()


@pytest.mark.usefixtures("in_place_of_itur")
def test_rates_per_kilometre_become_losses_of_the_way():
    air = {"model": "itu-r", "pressure_hpa": 1000.0, "water_vapour_g_m3": 3.0, "temperature_k": 300.0}
    air |= {"rain_mm_h": 8.0, "tilt_deg": 30.0}
    config = presets.load_radio("corrected", {"frequency_hz": 20e9, "atmosphere": air})
    radio, clear = Radio(config), Radio(presets.load_radio("corrected", {"frequency_hz": 20e9}))
    distance = np.array([500.0, 1500.0])
    terms = {term.name: np.asarray(term.contribution) for term in radio.link(distance).terms}
    assert terms["gas_db"] == pytest.approx(-20.0 * 1000.0 * 3.0 / 300.0 * distance * 1e-3)
    assert terms["rain_db"] == pytest.approx(-8.0 * 30.0 / 20.0 * distance * 1e-3)
    lost = clear.link(distance).received_power_dbm - radio.link(distance).received_power_dbm
    assert lost == pytest.approx(-(terms["gas_db"] + terms["rain_db"]))
    assert clear.link(distance).terms[-1].name == radio.link(distance).terms[-1].name == "path_loss_db"


@pytest.mark.usefixtures("in_place_of_itur")
def test_it_holds_up_to_the_borders_of_its_range():
    law = atmosphere.ItuAtmosphere()
    assert law.gas_loss_db(np.ones(2), np.array(law.frequencies_hz)).shape == (2,)
    for outside_hz in (0.999e9, 1.001e12):
        with pytest.raises(OutsideValidityError, match="allowed is 1 to 1000"):
            law.gas_loss_db(np.ones(1), outside_hz)


@pytest.mark.usefixtures("in_place_of_itur")
def test_a_medium_takes_the_atmosphere_into_account():
    air = {"frequency_hz": 20e9, "shadowing": {"model": "none"}, "atmosphere": {"model": "itu-r"}}
    radio = Radio(presets.load_radio("corrected", air))
    medium = Medium(radio, seed=1, nodes=["a", "b", "c", "d", "e", "f", "g"])
    for k, node in enumerate("abcdefg"):
        medium.observe(node, 0, (5.0 * k, 0.0, -40.0))
    medium.send(medium.packets(tx="a", seq=0, length_bytes=40))
    receptions = rows(medium, medium.flush())
    for reception in receptions:
        expected = float(radio.link(reception.distance_m).received_power_dbm)
        assert reception.received_power_dbm == round(expected, 3)
    assert len(receptions) == 6


@needs_itur
def test_the_terms_are_named_and_sum_to_the_received_power():
    radio = Radio(presets.load_radio("corrected", RAIN))
    link = radio.link([500.0, 2000.0])
    terms = {term.name: np.asarray(term.contribution) for term in link.terms}
    assert [name for name in terms if name != "horizon_db"][-3:] == ["gas_db", "rain_db", "path_loss_db"]
    assert sum(terms.values()) == pytest.approx(link.received_power_dbm, abs=1e-12)
    assert radio.mean_power_dbm(radio.path([500.0, 2000.0])) == pytest.approx(link.received_power_dbm)
    assert terms["rain_db"][1] == pytest.approx(4.0 * terms["rain_db"][0])
    without = Radio(presets.load_radio("corrected", {"frequency_hz": 28e9})).link([500.0, 2000.0])
    taken = without.received_power_dbm - link.received_power_dbm
    assert taken == pytest.approx(-(terms["gas_db"] + terms["rain_db"]))


@needs_itur
def test_values_of_the_recommendations():
    """ITU-R P.838-3, table 5, at 28 GHz: k_H 0.2051, alpha_H 0.9679; P.676: the oxygen line at 60 GHz."""
    level = {"model": "itu-r", "rain_mm_h": 50.0, "tilt_deg": 0.0}
    config = presets.load_radio("corrected", {"atmosphere": level})
    rain = config.atmosphere.rain_loss_db(np.array(1000.0), 28e9)
    assert float(rain) == pytest.approx(0.2051 * 50.0**0.9679, rel=1e-3)
    gas = config.atmosphere.gas_loss_db(np.array(1000.0), np.array([2.4e9, 60e9]))
    assert gas[0] < 0.01
    assert 13.0 < gas[1] < 16.0


@needs_itur
def test_frequencies_below_the_recommendations_are_named():
    config = presets.load_radio(
        "corrected", {"atmosphere": {"model": "itu-r", "outside": "refuse"}, "frequency_hz": 915e6}
    )
    with pytest.raises(ValueError, match="frequency_ghz"):
        Radio(config).link(100.0)
