import warnings

import numpy as np
import pytest

from channel.checks import ChannelInputError
from channel.geometry import Path
from channel.propagation.air_to_ground import AlHourani, RmaAv, UmaAv
from channel.propagation.hata import OkumuraHata
from channel.propagation.path_loss import friis_loss_db
from channel.validity import ValidityWarning


def path(ground_m, tx_m, rx_m, frequency_hz=2e9):
    ground = np.asarray(ground_m, dtype=float)
    return Path(frequency_hz, np.hypot(ground, tx_m - rx_m), tx_m, rx_m)


def test_al_hourani_sees_everything_from_overhead_and_little_from_afar():
    model = AlHourani(environment="urban")
    overhead, far = path(0.0, 100.0, 1.5), path(1000.0, 100.0, 1.5)
    assert float(model.line_of_sight_probability(overhead)) == pytest.approx(1.0, abs=1e-4)
    by_hand = 1.0 / (1.0 + 9.61 * np.exp(-0.16 * (np.degrees(np.arctan2(98.5, 1000.0)) - 9.61)))
    assert float(model.line_of_sight_probability(far)) == pytest.approx(by_hand)
    excess = float(model.path_loss_db(far) - friis_loss_db(far.distance_m, 2e9))
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
    clear = max(23.9 - 1.8 * np.log10(35), 20) * slant + constant
    assert float(RmaAv(line_of_sight="always").path_loss_db(where)) == pytest.approx(clear)
    high = path(3000.0, 35.0, 50.0, 8e8)
    assert float(RmaAv().line_of_sight_probability(high)) == 1.0
    assert float(RmaAv().path_loss_db(high)) == pytest.approx(
        float(RmaAv(line_of_sight="always").path_loss_db(high))
    )


def test_outside_its_range_a_model_warns_once_by_name():
    model = OkumuraHata()
    low = Path(900e6, np.asarray(1500.0), 30.0, 0.5)
    with pytest.warns(ValidityWarning, match=r"height of the mobile = 0\.5: outside 1 to 10.*okumura-hata"):
        model.path_loss_db(low)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.path_loss_db(low)


def test_or_refuses_or_says_nothing():
    low = Path(900e6, np.asarray(1500.0), 30.0, 0.5)
    with pytest.raises(ChannelInputError, match=r"height of the mobile = 0\.5: allowed is 1 to 10"):
        OkumuraHata(outside="refuse").path_loss_db(low)
    assert np.isfinite(OkumuraHata(outside="ignore").path_loss_db(low))
