import numpy as np
import pytest
from pydantic import ValidationError

from channel import presets
from channel.link.emitters.emitter import Emitter
from channel.link.radio import Radio
from channel.medium.medium import Fate, Medium
from channel.phy.interference import Interferer, sum_dbm
from channel.phy.noise import thermal_noise_dbm
from channel.presets import PresetError
from tests.unit.channel.medium.one_by_one import settled


def radio(duty=1.0, frequency_hz=None, power_dbm=30.0):
    jammer = {"position_ned_m": [500.0, 0.0, -40.0], "power_dbm": power_dbm, "duty": duty, "slot_s": 0.001}
    if frequency_hz:
        jammer["frequency_hz"] = frequency_hz
    return Radio(presets.load_radio("corrected", {"interference": {"interferers": [jammer]}}))


def test_thermal_noise_of_20_mhz():
    assert float(thermal_noise_dbm(20e6, 6.0)) == pytest.approx(-173.975 + 73.0103 + 6.0, abs=1e-3)


def test_powers_add_in_watt():
    assert float(sum_dbm(-90.0, [np.asarray(-90.0)])) == pytest.approx(-86.9897, abs=1e-4)


def test_jammer_raises_the_noise_by_its_received_power():
    model = radio()
    link = model.link(100.0)
    alone = 30.0 + 2.3 - float(model.config.propagation.path_loss_db(model.path(400.0)))
    expected = 10 * np.log10(10 ** (alone / 10) + 10 ** (model.noise_floor_dbm / 10))
    assert float(link.noise_dbm) == pytest.approx(expected, abs=1e-6)
    assert float(link.snr_db) == pytest.approx(float(link.received_power_dbm) - expected, abs=1e-6)


@pytest.mark.parametrize(
    ("overrides", "wanted_db", "unwanted_db"),
    [
        ({"offset_db": -7.0}, -7.0, -7.0),
        ({"cable_loss_db": 2.0}, -4.0, -2.0),
        ({"receive_antenna": {"model": "isotropic", "gain_db": -1.7}}, -4.0, -4.0),
    ],
)
def test_what_the_receiver_takes_it_takes_of_wanted_and_unwanted_alike(overrides, wanted_db, unwanted_db):
    """With the jammer far above the noise: the noise that a receiver reports is the jammer's power."""
    jammer = {"position_ned_m": [500.0, 0.0, -40.0], "power_dbm": 100.0}
    base = {"interference": {"interferers": [jammer]}, "noise": {"model": "fixed", "floor_dbm": -200.0}}
    plain, other = (
        Radio(presets.load_radio("corrected", base | more)).link(100.0) for more in ({}, overrides)
    )
    assert float(other.received_power_dbm - plain.received_power_dbm) == pytest.approx(wanted_db)
    assert float(other.noise_dbm - plain.noise_dbm) == pytest.approx(unwanted_db, abs=1e-6)


def test_adjacent_channel_is_rejected():
    beside, on = radio(1.0, 2.432e9, 90.0), radio(1.0, 2.412e9, 90.0)
    drop_db = beside.noise_dbm(beside.path(100.0)) - on.noise_dbm(on.path(100.0))
    friis_db = 20 * np.log10(2.432 / 2.412)
    assert float(drop_db) == pytest.approx(-28.0 - friis_db, abs=0.02)


@pytest.mark.parametrize("duty", [0.0, 0.3, 1.0])
def test_pulsed_jammer_monte_carlo_agrees_with_the_closed_probability(duty):
    model = radio(duty, power_dbm=15.0)
    medium = Medium(model, seed=1, nodes=["0", "1"])
    medium.place("0", (0, 0, -40))
    medium.place("1", (60, 0, -40))
    n = 3000
    times_ns = 1_000_000 * np.arange(n)
    medium.send(medium.packets(tx="0", seq=np.arange(n), sim_time_ns=times_ns, length_bytes=100))
    fates = settled(medium)
    p = float(model.probability_of_delivery(60.0, 100))
    assert fates[0].probability_of_delivery == pytest.approx(p, abs=5e-3)
    delivered = sum(each.fate is Fate.DELIVERED for each in fates)
    assert abs(delivered / n - p) < 3.29 * np.sqrt(p * (1 - p) / n) + 1 / n


def test_bad_rejection_curve_names_its_key():
    with pytest.raises(PresetError, match=r"interference: .*offsets have to rise"):
        presets.load_radio("corrected", {"interference": {"rejection": [[0, 0], [0, 3]]}})


@pytest.mark.parametrize("rejection_db", [-20.0, 4000.0])
def test_a_rejection_neither_amplifies_nor_is_beyond_numbers(rejection_db):
    with pytest.raises(PresetError, match="rejection: from 0 to 300 dB"):
        presets.load_radio("corrected", {"interference": {"rejection": [[0, rejection_db]]}})


def test_slots_of_an_interferer_are_those_of_an_emitter():
    """To the nanosecond, and no shorter or longer ones than can be counted."""
    kind = {"frequency_hz": 2.4e9, "power_dbm": 0.0}
    for slot_s in (1e-6, 0.1291, 1.001, 1e6):
        emitter = Emitter(name="jammer", slot_s=slot_s, **kind)
        assert Interferer(position_ned_m=(0.0, 0.0, 0.0), slot_s=slot_s, **kind).slot_ns == emitter.slot_ns
    for slot_s in (1e-9, 1e10):
        with pytest.raises(ValidationError, match="slot_s"):
            Interferer(position_ned_m=(0.0, 0.0, 0.0), slot_s=slot_s, **kind)
