"""The level from which a receiver locks on: what it takes from deliveries, by the normal law written out here."""

from math import erf, log10, sqrt
from typing import Any

import numpy as np
import pytest

from channel.access.settings.base import Surroundings
from channel.access.settings.csma import CsmaMedium
from channel.access.world import PlainWorld
from channel.checks import FloatArray
from channel.draws import Draws
from channel.link.expectation import Expectation
from channel.link.radio import Radio
from channel.link.tables.lengths import Lengths
from channel.medium.medium import Fate, Medium
from channel.medium.simulate import simulate
from channel.phy.error_model import Band
from channel.presets import radio_from_mapping
from tests.unit.channel.medium.one_by_one import settled

LEVEL_DBM, SIGMA_DB = -82.0, 3.0
RADIO: dict[str, Any] = {
    "frequency_hz": 2.4e9,
    "bandwidth_hz": 1e6,
    "bit_rate_bps": 1e6,
    "transmit_power_dbm": 20.0,
    "antenna": {"model": "isotropic", "gain_db": 0.0},
    "earth_radius_factor": None,
    "propagation": {"model": "free-space"},
    "noise": {"model": "fixed", "floor_dbm": -110.0},
    "error": {"model": "threshold", "snr_min_db": 10.0},
    "medium": {"model": "csma", "preamble_dbm": LEVEL_DBM},
}
"""Its sensitivity is -100 dBm: 18 dB below the level."""
SHADOWED = {"shadowing": {"model": "normal", "sigma_db": SIGMA_DB}}
LOSS_AT_1_M_DB = 20.0 * log10(4.0 * np.pi * 2.4e9 / 299_792_458.0)


def radio(**more: Any) -> Radio:
    return Radio(radio_from_mapping(RADIO | more))


def mean_dbm(distance_m: FloatArray) -> FloatArray:
    return 20.0 - LOSS_AT_1_M_DB - 20.0 * np.log10(distance_m)


def normal_share(margin_db: FloatArray) -> list[float]:
    """The chance of a normal loss below a margin."""
    return [0.5 * (1.0 + erf(each / SIGMA_DB / sqrt(2.0))) for each in margin_db.tolist()]


DISTANCES_M = np.array([500.0, 800.0, 1000.0, 1251.0, 1500.0, 2500.0])


def test_without_random_terms_it_is_a_step() -> None:
    """-82 dBm is at 1251.5 m; by noise alone packets would come as far as 9.9 km."""
    heard = mean_dbm(DISTANCES_M) >= LEVEL_DBM
    assert heard.tolist() == [True, True, True, True, False, False]
    assert radio().probability_of_delivery(DISTANCES_M).tolist() == heard.tolist()
    assert radio().expected_delivery(DISTANCES_M).tolist() == heard.tolist()


INTERFERED = {"interferers": [{"name": "one", "position_ned_m": [0.0, 300.0, -40.0], "power_dbm": -30.0}]}
"""90 dB of loss and less over all of the way: noise rises by up to 10 dB, and no packet is lost to it."""


@pytest.mark.parametrize("more", [{}, {"interference": INTERFERED}])
def test_shadowing_takes_the_share_of_powers_below_the_level(more: dict[str, Any]) -> None:
    """It is a level of the power: noise does not move it."""
    shadowed = radio(**SHADOWED, **more)
    expected = normal_share(mean_dbm(DISTANCES_M) - LEVEL_DBM)
    delivery = shadowed.delivery(DISTANCES_M)
    assert delivery.probability.tolist() == pytest.approx(expected, abs=1e-6)
    tolerance = 2e-3 if more else 2e-5  # where noise varies, levels of SNR are in steps of 0.02 dB
    assert shadowed.expected_delivery(DISTANCES_M).tolist() == pytest.approx(expected, abs=tolerance)


def test_rayleigh_fading_takes_its_share() -> None:
    """P(gain below m) = 1 - exp(-m), m the ratio of level to mean."""
    faded = radio(fading={"model": "rayleigh"})
    expected = np.exp(-(10.0 ** ((LEVEL_DBM - mean_dbm(DISTANCES_M)) / 10.0))).tolist()
    assert faded.probability_of_delivery(DISTANCES_M).tolist() == pytest.approx(expected, abs=2e-3)
    assert faded.expected_delivery(DISTANCES_M).tolist() == pytest.approx(expected, abs=2e-3)


def test_a_level_below_which_noise_takes_all_is_none() -> None:
    """The noise floor, unless given, where the radio needs 10 dB over it; not where it reads 10 dB below it."""
    assert not radio(medium={"model": "csma"}).needs_preamble
    assert not radio(medium={"model": "ideal"}).needs_preamble
    deep = radio(medium={"model": "airtime"}, error={"model": "threshold", "snr_min_db": -10.0})
    assert deep.locks_from_dbm == -110.0
    far_m = np.array([30_000.0, 34_000.0])  # -109.6 and -110.7 dBm
    assert deep.probability_of_delivery(far_m).tolist() == [1.0, 0.0]
    low = radio(
        medium={"model": "airtime", "preamble_dbm": -120.0}, error={"model": "threshold", "snr_min_db": -10.0}
    )
    assert low.probability_of_delivery(far_m).tolist() == [1.0, 1.0]


def test_energy_of_802_11_is_sensed_from_the_standards_level_on() -> None:
    """By the channel's width, or 20 dB above a level that is given, or what is given."""
    assert CsmaMedium().senses_from_dbm(-95.0) == -62.0
    assert CsmaMedium(standard="11b", rate_mbps=11.0).senses_from_dbm(-95.0) == -73.0
    narrow = {clock: CsmaMedium(standard="11a", clock=clock) for clock in (1.0, 0.5, 0.25)}
    assert [each.senses_from_dbm(-95.0) for each in narrow.values()] == [-62.0, -65.0, -68.0]
    assert CsmaMedium(preamble_dbm=-90.0).senses_from_dbm(-95.0) == -70.0
    assert CsmaMedium(preamble_dbm=-90.0, energy_dbm=-75.0).senses_from_dbm(-95.0) == -75.0


@pytest.mark.parametrize(
    ("standard", "clock", "cca_us"), [("11g", 1.0, 4), ("11a", 0.5, 8), ("11a", 0.25, 16), ("11b", 1.0, 15)]
)
def test_a_carrier_is_sensed_after_as_long_as_symbols_last(standard: str, clock: float, cca_us: int) -> None:
    """aCCATime, and the energy in mW."""
    medium = CsmaMedium.model_validate(
        {"standard": standard, "clock": clock, "rate_mbps": 11.0 if standard == "11b" else 6.0}
    )
    surroundings = Surroundings.of(
        PlainWorld((0, 1)), {"a": 0, "b": 1}, 1, radio_from_mapping({"preset": "wifi-2.4"}), -95.0
    )
    hearing = medium.hearing(surroundings)
    assert hearing.cca_ns == 1000 * cca_us
    assert hearing.energy_mw == pytest.approx(10.0 ** (medium.senses_from_dbm(-95.0) / 10.0))


def test_a_medium_says_which_packets_were_too_weak() -> None:
    """Each by its own power; the level is that of the quietest receiver, if none is given."""
    one = radio(**SHADOWED)
    both = Medium(one, seed=5, nodes=["a", "b"])
    both.place("a", (0.0, 0.0, -40.0))
    both.place("b", (1251.0, 0.0, -40.0))
    both.send(both.packets(tx="a", seq=np.arange(400), length_bytes=30))
    got = settled(both)
    fates = {each.fate for each in got}
    assert fates == {Fate.DELIVERED, Fate.BELOW_PREAMBLE}
    assert all((each.received_power_dbm < LEVEL_DBM) == (each.fate is Fate.BELOW_PREAMBLE) for each in got)
    assert {each.per for each in got} == {0.0}
    batch = simulate(one, Draws(5), [("a", "b")], 1251.0, packets=400)
    assert batch.delivered[0].tolist() == [each.fate is Fate.DELIVERED for each in got]

    deep = {"medium": {"model": "airtime"}, "error": {"model": "threshold", "snr_min_db": -10.0}}
    loud = radio(**deep | {"noise": {"model": "fixed", "floor_dbm": -106.0}})
    mixed = Medium({"a": radio(**deep), "b": loud}, seed=5, nodes=["a", "b"])
    mixed.place("a", (0.0, 0.0, -40.0))
    mixed.place("b", (25_000.0, 0.0, -40.0))  # -108.0 dBm
    mixed.send(mixed.packets(tx="a", seq=np.arange(3), length_bytes=30))
    assert {each.fate for each in settled(mixed)} == {Fate.DELIVERED}


@pytest.mark.slow
@pytest.mark.parametrize("fading", ["none", "rayleigh"])
def test_a_level_for_each_link_needs_few_curves_and_is_near_the_quadrature(fading: str) -> None:
    """Interference is another at each link and instant: a curve for each level would take seconds per tick."""
    random = {"fading": {"model": fading}, "shadowing": {"model": "normal", "sigma_db": 4.0}}
    one = Expectation(
        radio(**random, error={"model": "uncoded-awgn", "modulation": "qpsk"}).config, Band(1e6, 1e6)
    )
    rng = np.random.Generator(np.random.PCG64(1))
    least_db = rng.uniform(-30.0, 30.0, 500)
    snr_db = least_db + rng.normal(0.0, 8.0, 500)
    found = one.from_table(snr_db, Lengths.same(50), None, least_db)
    exact = one.averaged(snr_db, np.array(50.0), np.array(0.0), least_db=least_db)
    assert np.abs(found - exact).max() < 0.01
    assert len(one._curves._rows) < 100
