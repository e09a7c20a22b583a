import warnings

import numpy as np
import pytest

from channel.geometry import Path
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.presets import load_radio, preset_names
from channel.propagation.air_to_ground import AlHourani, RmaAv, UmaAv
from channel.propagation.hata import OkumuraHata
from channel.propagation.path_loss import friis_db
from channel.validity import OutsideValidityError, ValidityWarning


def path(ground_m, tx_m, rx_m, frequency_hz=2e9):
    ground = np.asarray(ground_m, dtype=float)
    return Path(frequency_hz, np.hypot(ground, tx_m - rx_m), tx_m, rx_m)


def test_al_hourani_sees_everything_from_overhead_and_little_from_afar():
    model = AlHourani(environment="urban")
    overhead, far = path(0.0, 100.0, 1.5), path(1000.0, 100.0, 1.5)
    assert float(model.line_of_sight_probability(overhead)) == pytest.approx(1.0, abs=1e-4)
    by_hand = 1.0 / (1.0 + 9.61 * np.exp(-0.16 * (np.degrees(np.arctan2(98.5, 1000.0)) - 9.61)))
    assert float(model.line_of_sight_probability(far)) == pytest.approx(by_hand)
    excess = float(model.path_loss_db(far) - friis_db(far.distance_m, 2e9))
    assert excess == pytest.approx(by_hand * 1.0 + (1.0 - by_hand) * 20.0)


def test_uma_av_by_hand():
    where = path(500.0, 25.0, 60.0)
    d1, p1 = 460 * np.log10(60) - 700, 4300 * np.log10(60) - 3800
    sight = d1 / 500 + np.exp(-500 / p1) * (1 - d1 / 500)
    assert float(UmaAv().line_of_sight_probability(where)) == pytest.approx(sight)
    clear = 28 + 22 * np.log10(np.hypot(500, 35)) + 20 * np.log10(2.0)
    assert float(UmaAv(line_of_sight="always").path_loss_db(where)) == pytest.approx(clear)
    hidden = -17.5 + (46 - 7 * np.log10(60)) * np.log10(np.hypot(500, 35)) + 20 * np.log10(40 * np.pi * 2 / 3)
    assert float(UmaAv(line_of_sight="never").path_loss_db(where)) == pytest.approx(hidden)
    assert float(UmaAv().path_loss_db(where)) == pytest.approx(sight * clear + (1 - sight) * hidden)


def test_rma_av_by_hand_and_clear_above_40_m():
    where = path(3000.0, 35.0, 30.0, 8e8)
    constant = 20 * np.log10(40 * np.pi * 0.8 / 3)
    slant = np.log10(np.hypot(3000, 5))
    clear = max(23.9 - 1.8 * np.log10(30), 20) * slant + constant
    assert float(RmaAv(line_of_sight="always").path_loss_db(where)) == pytest.approx(clear)
    high = path(3000.0, 35.0, 50.0, 8e8)
    assert float(RmaAv().line_of_sight_probability(high)) == 1.0
    assert float(RmaAv().path_loss_db(high)) == pytest.approx(
        float(RmaAv(line_of_sight="always").path_loss_db(high))
    )


def sight_by_table(ground_m, height_m):
    """TR 36.777, table B-1, RMa-AV, up to 40 m: d1 / d + exp(-d / p1) (1 - d1 / d)."""
    d1 = max(1350.8 * np.log10(height_m) - 1602.0, 18.0)
    p1 = max(15021.0 * np.log10(height_m) - 16053.0, 1000.0)
    return d1 / ground_m + np.exp(-ground_m / p1) * (1.0 - d1 / ground_m)


def power_by_table_dbm(ground_m, base_m, ua_m):
    """Of `lte-like` with the table's mean loss over both states, B-2 at 800 MHz: 23 dBm and 5 dB more."""
    slant, constant = np.log10(np.hypot(ground_m, base_m - ua_m)), 20 * np.log10(40 * np.pi * 0.8 / 3)
    clear = max(23.9 - 1.8 * np.log10(ua_m), 20) * slant + constant
    hidden = max(clear, -12 + (35 - 5.3 * np.log10(ua_m)) * slant + constant)
    seen = sight_by_table(ground_m, ua_m)
    return 28.0 - seen * clear - (1 - seen) * hidden


PLAIN_CELL = {
    "shadowing": {"model": "none"},
    "fading": {"model": "none"},
    "earth_radius_factor": None,
    "propagation": {"line_of_sight": "expected"},
}


def test_a_ua_below_its_base_is_still_the_aircraft():
    """A base at 35 m, a UA at 15 m: two thirds of the places 650 m off see each other, not nineteen in twenty."""
    radio = Radio(load_radio("lte-like", PLAIN_CELL))
    down = radio.path(ground_distance_m=650.0, height_tx_m=35.0, height_rx_m=15.0)
    up = radio.path(ground_distance_m=650.0, height_tx_m=15.0, height_rx_m=35.0, base="rx")
    for way in (down, up):
        share = float(radio.config.propagation.line_of_sight_probability(way))
        assert share == pytest.approx(sight_by_table(650.0, 15.0), abs=1e-12)
        assert share == pytest.approx(0.678, abs=1e-3)
        assert float(radio.mean_power_dbm(way)) == pytest.approx(power_by_table_dbm(650.0, 35.0, 15.0))


def test_who_is_the_base_comes_from_the_nodes_of_a_medium():
    medium = Medium(Radio(load_radio("lte-like", PLAIN_CELL)), seed=1, nodes=["ua", "tower"], bases=["tower"])
    medium.place("ua", (650.0, 0.0, -15.0))
    medium.place("tower", (0.0, 0.0, -35.0))
    for sender in ("ua", "tower"):
        medium.send(medium.packets(tx=sender, seq=0, length_bytes=40))
    by_table = power_by_table_dbm(650.0, 35.0, 15.0)
    assert medium.settle().received_power_dbm == pytest.approx([by_table, by_table], abs=6e-4)


def test_two_of_a_kind_are_refused_or_counted_with_the_lower_end_as_the_base():
    two = path(500.0, 25.0, 60.0)._replace(tx_is_base=False)
    with pytest.raises(
        OutsideValidityError, match="ends of a link = 'two of a kind': allowed is a ground node"
    ):
        UmaAv().path_loss_db(two)
    with pytest.warns(ValidityWarning, match="two of a kind"):
        UmaAv(outside="warn").path_loss_db(two)
    assert UmaAv(outside="clamp").path_loss_db(two) == UmaAv().path_loss_db(path(500.0, 25.0, 60.0))
    with pytest.raises(OutsideValidityError):
        UmaAv().path_loss_db(two._replace(tx_is_base=True, rx_is_base=True))


LOW = Path(900e6, np.asarray(1500.0), 30.0, 0.5)


def test_outside_its_range_a_model_refuses_by_name():
    with pytest.raises(
        OutsideValidityError, match=r"height of the mobile = 0\.5: allowed is 1 to 10.*okumura-hata"
    ):
        OkumuraHata().path_loss_db(LOW)


def test_the_nonsense_of_two_aircraft_in_a_formula_for_streets_is_refused():
    """Both ends at 100 m, 500 m apart: the formula gives a gain of 142 dB."""
    between_aircraft = Path(900e6, np.asarray(500.0), 100.0, 100.0)
    with pytest.raises(OutsideValidityError, match="height of the mobile = 100"):
        OkumuraHata().path_loss_db(between_aircraft)
    with pytest.warns(ValidityWarning):
        assert float(OkumuraHata(outside="warn").path_loss_db(between_aircraft)) < -100.0
    held = float(OkumuraHata(outside="clamp").path_loss_db(between_aircraft))
    at_the_border = float(OkumuraHata().path_loss_db(Path(900e6, np.asarray(1000.0), 100.0, 10.0)))
    assert held == pytest.approx(at_the_border - 20.0 * np.log10(2.0))


def test_or_warns_once():
    model = OkumuraHata(outside="warn")
    with pytest.warns(ValidityWarning, match=r"height of the mobile = 0\.5: outside 1 to 10.*okumura-hata"):
        model.path_loss_db(LOW)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.path_loss_db(LOW)


def test_beyond_its_distance_a_clamped_law_goes_on_as_free_space():
    clamped = RmaAv(outside="clamp", line_of_sight="always")
    far, border = path(40_000.0, 50.0, 50.0, 8e8), path(10_000.0, 50.0, 50.0, 8e8)
    more = float(clamped.path_loss_db(far) - clamped.path_loss_db(border))
    assert more == pytest.approx(20.0 * np.log10(4.0))
    assert float(clamped.path_loss_db(border)) == float(RmaAv(line_of_sight="always").path_loss_db(border))
    with pytest.raises(OutsideValidityError, match="ground distance = 40000"):
        RmaAv().path_loss_db(far)
    with pytest.raises(OutsideValidityError, match="height of the aircraft = 301"):
        RmaAv().path_loss_db(path(1000.0, 35.0, 301.0, 8e8))


@pytest.mark.parametrize("name", preset_names())
def test_presets_stay_inside(name):
    """From the ground to 400 m, from 1 m to 100 km, without a warning and without a refusal."""
    radio = Radio(load_radio(name))
    for height in (0.2, 40.0, 400.0):
        ends = {"height_tx_m": height, "height_rx_m": 10.0}
        received = radio.link(ground_distance_m=np.geomspace(1.0, 1e5, 30), **ends).received_power_dbm
        assert np.all(np.isfinite(received))
