"""A radio per node: what each end brings into a link, by hand calculation; nobody else's radio changes a fate."""

import numpy as np
import pytest

from channel import presets
from channel.checks import ChannelInputError
from channel.config import RadioConfig
from channel.link.radio import Radio
from channel.medium.medium import Fate, Medium
from tests.unit.channel.medium.one_by_one import settled

FREE_SPACE_1_KM_DB = 32.4478 + 67.6042
"""ITU-R P.525, eq. 4: 32.4478 + 20 log10(1 km) + 20 log10(2400 MHz)."""
COMMON = {"frequency_hz": 2.4e9, "earth_radius_factor": None}
STRONG = {
    **COMMON,
    "name": "strong",
    "transmit_power_dbm": 20.0,
    "antenna": {"model": "isotropic", "gain_db": 3.0},
    "cable_loss_db": 1.0,
    "noise": {"model": "fixed", "floor_dbm": -95.0},
    "error": {"model": "threshold", "snr_min_db": 20.0},
    "length": {"model": "payload", "overhead_bytes": 10},
    "max_range_m": 2500.0,
}
QUIET = {
    **COMMON,
    "name": "quiet",
    "transmit_power_dbm": 10.0,
    "antenna": {"model": "isotropic", "gain_db": 8.0},
    "receive_antenna": {"model": "isotropic", "gain_db": 5.0},
    "cable_loss_db": 2.0,
    "offset_db": -4.0,
    "noise": {"model": "fixed", "floor_dbm": -100.0},
    "error": {"model": "threshold", "snr_min_db": 5.0},
    "length": {"model": "fixed", "length_bytes": 77},
    "max_range_m": 1500.0,
}


def radio(tree, **overrides):
    return Radio(RadioConfig.model_validate(tree | overrides))


def exchanged(radios, distance_m, packets=1, **medium):
    """Packets of each of two nodes to the other, by transmitter."""
    both = Medium(radios, seed=5, nodes=["a", "b"], **medium)
    both.place("a", (0.0, 0.0, -40.0))
    both.place("b", (distance_m, 0.0, -40.0))
    for tx in both.nodes:
        both.send(both.packets(tx=tx, seq=np.arange(packets), length_bytes=30))
    got = settled(both)
    return [[each for each in got if each.tx == tx] for tx in both.nodes]


def test_power_and_noise_are_those_of_the_two_ends():
    (there,), (back,) = exchanged({"a": radio(STRONG), "b": radio(QUIET)}, 1000.0)
    assert there.received_power_dbm == pytest.approx(20 + 3 - 1 - FREE_SPACE_1_KM_DB + 5 - 2 - 4, abs=1e-3)
    assert there.snr_db == pytest.approx(there.received_power_dbm + 100.0, abs=1e-9)
    assert back.received_power_dbm == pytest.approx(10 + 8 - 2 - FREE_SPACE_1_KM_DB + 3 - 1, abs=1e-3)
    assert back.snr_db == pytest.approx(back.received_power_dbm + 95.0, abs=1e-9)
    assert (there.length_bytes, back.length_bytes) == (40, 77)
    assert there.fate is Fate.DELIVERED  # 20.9 dB, and the transmitter's modulation needs 20
    assert back.fate is Fate.DELIVERED  # 12.9 dB, of 5


def test_the_modulation_is_the_transmitters_and_the_range_the_shorter_one():
    radios = {"a": radio(STRONG), "b": radio(QUIET)}
    (there,), (back,) = exchanged(radios, 1400.0)  # 2.9 dB more loss
    assert (there.fate, back.fate) == (Fate.CHANNEL_ERASURE, Fate.DELIVERED)
    (there,), (back,) = exchanged(radios, 1501.0)
    assert (there.fate, back.fate) == (Fate.OUT_OF_RANGE, Fate.OUT_OF_RANGE)


def test_the_terms_of_the_budget_name_both_ends():
    link = radio(STRONG).towards(radio(QUIET)).link(1000.0)
    terms = {term.name: float(np.squeeze(term.contribution)) for term in link.terms}
    assert terms.pop("path_loss_db") == pytest.approx(-FREE_SPACE_1_KM_DB, abs=1e-3)
    assert terms == {
        "transmit_power_dbm": 20.0,
        "transmit_antenna_gain_db": 3.0,
        "receive_antenna_gain_db": 5.0,
        "transmit_cable_db": -1.0,
        "receive_cable_db": -2.0,
        "offset_db": -4.0,
    }


def test_noise_bandwidth_is_the_receivers_and_bit_rate_the_transmitters():
    """Eb/N0 = SNR * bandwidth / bit rate: 10 dB here if each is of its own end; BER = 0.5 erfc(sqrt(10))."""
    from scipy.special import erfc

    narrow = radio(STRONG, error={"model": "uncoded-awgn", "modulation": "bpsk"}, bit_rate_bps=1e5)
    wide = radio(QUIET, bandwidth_hz=1e6, bit_rate_bps=7e6)
    pair = narrow.towards(wide)
    assert float(pair.per(0.0, 1.0)) == pytest.approx(1.0 - (1.0 - 0.5 * erfc(np.sqrt(10.0))) ** 8, rel=1e-9)


def test_losses_that_come_in_any_range_are_the_receivers():
    radios = {"a": radio(STRONG, base_loss=0.3), "b": radio(QUIET, base_loss=0.0)}
    there, back = exchanged(radios, 300.0, packets=2000)
    assert {each.fate for each in there} == {Fate.DELIVERED}
    lost = sum(each.fate is Fate.BASE_LOSS for each in back)
    assert abs(lost / 2000 - 0.3) < 3.29 * np.sqrt(0.3 * 0.7 / 2000)


def test_a_jammer_is_heard_through_the_receivers_antenna_cable_and_offset():
    jammer = {"position_ned_m": [1000.0, 1000.0, -40.0], "power_dbm": 30.0}
    radios = {"a": radio(STRONG), "b": radio(QUIET, interference={"interferers": [jammer]})}
    (there,), (back,) = exchanged(radios, 1000.0)
    heard_dbm = 30.0 - FREE_SPACE_1_KM_DB + 5.0 - 2.0 - 4.0
    noise_dbm = 10.0 * np.log10(10.0 ** (heard_dbm / 10.0) + 10.0**-10.0)
    assert there.snr_db == pytest.approx(there.received_power_dbm - noise_dbm, abs=2e-3)
    assert back.snr_db == pytest.approx(back.received_power_dbm + 95.0, abs=1e-9)


def test_one_radio_for_all_and_equal_ones_for_each_give_the_same_fates():
    for name in ("moon2020", "wifi-2.4"):
        one = Radio(presets.load_radio(name))
        each = {node: Radio(presets.load_radio(name)) for node in "ab"}
        assert exchanged(one, 380.0, packets=50) == exchanged(each, 380.0, packets=50)


def test_a_link_is_the_same_whoever_else_is_there_with_whatever_radio():
    """Ends with another antenna than the third node's, and with random terms that it does not have."""
    carrier = {"frequency_hz": 2.4e9}
    radios = {
        "a": Radio(presets.load_radio("wifi-2.4", carrier)),
        "b": Radio(presets.load_radio("moon2020", carrier)),
        "c": Radio(presets.load_radio("corrected", carrier | {"base_loss": 0.1})),
    }
    got = []
    for nodes in ("ab", "abc", "cba"):
        medium = Medium({node: radios[node] for node in nodes}, seed=2, nodes=nodes)
        for tick in range(3):
            for node in nodes:
                position = ("abc".index(node) * 150.0 + tick, 3.0 * tick, -40.0)
                medium.observe(node, tick * 50_000_000, position, (0.8, 0.6, 0.0, 0.0))
        for node in nodes:
            medium.send(medium.packets(tx=node, seq=range(40), sim_time_ns=60_000_000, length_bytes=200))
        got.append({(e.tx, e.rx, e.seq): e for e in settled(medium) if "c" not in (e.tx, e.rx)})
    assert got[0] == got[1] == got[2]
    assert len(got[0]) == 80


def test_radios_on_two_frequencies_are_refused_and_a_node_without_one():
    with pytest.raises(
        ChannelInputError, match=r"frequency_hz of quiet = 9.*allowed is 2\.4e\+09, the frequency of strong"
    ):
        Medium({"a": radio(STRONG), "b": radio(QUIET, frequency_hz=9e8)}, seed=1, nodes="ab")
    with pytest.raises(ChannelInputError, match="radio = 'a': allowed is a radio for each node, b too"):
        Medium({"a": radio(STRONG)}, seed=1, nodes="ab")
