"""Emitters in the medium: they raise the noise of receivers near their frequency, from where they are."""

from __future__ import annotations

import numpy as np
import pytest

from channel import presets
from channel.checks import ChannelInputError
from channel.link.emitters.emitter import Emitter
from channel.link.radio import Radio
from channel.medium.medium import Medium, Receptions
from channel.medium.reception import Fate
from tests.unit.channel.medium.one_by_one import settled

CARRIER_HZ = 2.412e9
PLAIN = {"shadowing": {"model": "none"}, "antenna": {"model": "isotropic", "gain_db": 0.0}}


def emitter(**changes: object) -> Emitter:
    return Emitter(**{"name": "beacon", "frequency_hz": CARRIER_HZ, "power_dbm": 20.0} | changes)


def medium_of(*emitters: Emitter, **overrides: object) -> Medium:
    radio = Radio(presets.load_radio("corrected", PLAIN | overrides), emitters)
    medium = Medium(radio, seed=1, nodes=["0", "1"], emitters=[each.name for each in emitters])
    medium.place("0", (0.0, 0.0, -40.0))
    medium.place("1", (60.0, 0.0, -40.0))
    return medium


def flown(medium: Medium, times_ns: np.ndarray) -> Receptions:
    seq = np.arange(times_ns.size)
    medium.send(medium.packets(tx="0", seq=seq, sim_time_ns=times_ns, length_bytes=100, to="1"))
    return medium.settle()


def law_dbm(power_dbm: float, distance_m: np.ndarray) -> np.ndarray:
    """Free space to 1 m, then exponent 2.5."""
    first_m_db = 20.0 * np.log10(4.0 * np.pi * CARRIER_HZ / 299_792_458.0)
    return power_dbm - first_m_db - 25.0 * np.log10(distance_m)


def test_a_moving_emitter_raises_the_noise_by_its_power_from_where_it_is() -> None:
    medium = medium_of(emitter())
    for tick in range(11):
        medium.emitters.observe(["beacon"], tick * 100_000_000, [(60.0, 100.0 + 20.0 * tick, -40.0)])
    times_ns = np.arange(0, 1_000_000_001, 50_000_000)
    found = flown(medium, times_ns)
    distance_m = 100.0 + 200.0 * times_ns / 1e9
    floor_dbm = 10.0 * np.log10(1.380649e-23 * 290.0 * 20e6 * 1e3) + 6.0
    noise_w = 10 ** (law_dbm(20.0, distance_m) / 10.0) + 10 ** (floor_dbm / 10.0)
    expected_db = law_dbm(18.0, np.array(60.0)) - 10.0 * np.log10(noise_w)
    assert found.snr_db == pytest.approx(expected_db, abs=6e-4)


@pytest.mark.parametrize(("offset_hz", "heard"), [(50e6, True), (-50e6, True), (51e6, False), (1e9, False)])
def test_it_is_heard_as_far_off_as_the_receiver_says(offset_hz: float, heard: bool) -> None:
    medium = medium_of(emitter(frequency_hz=CARRIER_HZ + offset_hz, power_dbm=60.0))
    medium.emitters.observe(["beacon"], 0, [(60.0, 10.0, -40.0)])
    quiet = float(flown(medium_of(), np.zeros(1, np.int64)).snr_db[0])
    assert (float(flown(medium, np.zeros(1, np.int64)).snr_db[0]) < quiet - 1.0) == heard


def test_its_antenna_points_north() -> None:
    sector = {"model": "sector", "gain_db": 10.0, "front_to_back_db": 30.0}
    medium = medium_of(emitter(antenna=sector, power_dbm=60.0))
    snr_db = []
    for tick, north_m in enumerate((-140.0, 260.0)):  # node 1 north of it, then south
        medium.emitters.observe(["beacon"], tick, [(north_m, 0.0, -40.0)])
        snr_db.append(float(flown(medium, np.array([tick])).snr_db[0]))
    assert snr_db[1] - snr_db[0] == pytest.approx(30.0, abs=1e-2)


def test_a_pulsed_one_costs_what_the_closed_probability_says() -> None:
    pulsed = emitter(power_dbm=12.0, duty=0.3, slot_s=0.001)
    medium = medium_of(pulsed)
    medium.emitters.observe(["beacon"], 0, [(60.0, 40.0, -40.0)])
    count = 3000
    seq, times_ns = np.arange(count), 1_000_000 * np.arange(count)
    medium.send(medium.packets(tx="0", seq=seq, sim_time_ns=times_ns, length_bytes=100, to="1"))
    fates = settled(medium)
    delivered = sum(each.fate is Fate.DELIVERED for each in fates)
    chance = fates[0].probability_of_delivery
    assert 0.68 < chance < 0.99
    assert abs(delivered / count - chance) < 3.29 * np.sqrt(chance * (1 - chance) / count) + 1 / count


def test_others_do_not_change_when_one_is_on() -> None:
    """Slots are keyed by name: another emitter beside it moves none of its own."""
    times_ns = 1_000_000 * np.arange(500)
    pulsed = emitter(power_dbm=12.0, duty=0.3, slot_s=0.001)
    faint = emitter(name="other", power_dbm=-150.0, duty=0.5)
    snr_db = []
    for emitters in ((pulsed,), (faint, pulsed), (pulsed, faint)):
        medium = medium_of(*emitters)
        medium.emitters.observe([each.name for each in emitters], 0, [(60.0, 40.0, -40.0)] * len(emitters))
        snr_db.append(flown(medium, times_ns).snr_db)
    assert len(np.unique(snr_db[0])) == 2
    assert snr_db[1] == pytest.approx(snr_db[0], abs=2e-3)
    assert snr_db[2] == pytest.approx(snr_db[0], abs=2e-3)


def test_mistakes_are_named() -> None:
    medium = medium_of(emitter())
    with pytest.raises(ChannelInputError, match="places were observed"):
        flown(medium, np.zeros(1, np.int64))
    with pytest.raises(ChannelInputError, match="one of beacon"):
        medium.emitters.observe(["nobody"], 0, [(0.0, 0.0, 0.0)])
    with pytest.raises(ChannelInputError, match="with beacon"):
        Medium(Radio(presets.load_radio("corrected"), [emitter()]), seed=1, nodes=["0", "1"])
    many = [emitter(name=f"e{i}", duty=0.5) for i in range(9)]
    with pytest.raises(ChannelInputError, match="at most 8"):
        Radio(presets.load_radio("corrected"), many)
