"""Interferers and emitters have the random terms of the radio's links; the oracles are laws written here."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from channel import presets
from channel.link.emitters.emitter import Emitter
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.sensing.measured import Places
from channel.sensing.sensing import Sensing
from channel.sensing.sensor import SensorConfig

CARRIER_HZ = 2.412e9
BARE = {
    "antenna": {"model": "isotropic", "gain_db": 0.0},
    "shadowing": {"model": "none"},
    "noise": {"model": "fixed", "floor_dbm": -180.0},
    "earth_radius_factor": None,
}
UA_M, TOWER_M, AWAY_M = 30.0, 25.0, 1000.0
COUNT = 3000


def tower(**changes: object) -> Emitter:
    return Emitter(**{"name": "tower", "frequency_hz": CARRIER_HZ, "power_dbm": 30.0} | changes)


def radio_near(emitter: Emitter, **overrides: object) -> Radio:
    return Radio(presets.load_radio("corrected", BARE | overrides), [emitter])


def noise_of(radio: Radio, seed: int, count: int = 1, network: str = "") -> tuple[np.ndarray, float]:
    """Noise of each packet as the record has it, dBm, and the first one's probability of delivery."""
    medium = Medium(radio, seed=seed, nodes=["0", "1"], emitters=["tower"], network=network)
    medium.emitters.observe(["tower"], 0, [(0.0, 0.0, -TOWER_M)])
    medium.place("0", (AWAY_M, 30.0, -UA_M))
    medium.place("1", (AWAY_M, 0.0, -UA_M))
    medium.send(medium.packets(tx="0", seq=np.arange(count), length_bytes=100, to="1"))
    found = medium.settle()
    return found.received_power_dbm - found.snr_db, float(found.probability_of_delivery[0])


def states_dbm() -> tuple[float, float, float]:
    """TR 36.777, UMa-AV: chance of a line of sight, power with and without, of 30 dBm."""
    d1, p1 = max(460 * np.log10(UA_M) - 700, 18), 4300 * np.log10(UA_M) - 3800
    share = d1 / AWAY_M + np.exp(-AWAY_M / p1) * (1 - d1 / AWAY_M)
    slant, f_ghz = np.log10(np.hypot(AWAY_M, UA_M - TOWER_M)), CARRIER_HZ / 1e9
    clear = 28 + 22 * slant + 20 * np.log10(f_ghz)
    hidden = -17.5 + (46 - 7 * np.log10(UA_M)) * slant + 20 * np.log10(40 * np.pi * f_ghz / 3)
    return share, 30.0 - clear, 30.0 - hidden


@pytest.mark.slow
def test_a_tower_is_seen_or_hidden_and_not_at_the_mean_of_both_in_db() -> None:
    share, seen_dbm, hidden_dbm = states_dbm()
    law = {"propagation": {"model": "uma-av", "outside": "clamp"}}
    radio = radio_near(tower(), **law)
    noise_dbm = np.array([noise_of(radio, seed)[0][0] for seed in range(300)])
    seen = np.abs(noise_dbm - seen_dbm) < 2e-3
    assert np.all(seen | (np.abs(noise_dbm - hidden_dbm) < 2e-3))
    assert abs(seen.mean() - share) < 3.29 * np.sqrt(share * (1 - share) / 300)
    watt_dbm = 10 * np.log10(share * 10 ** (seen_dbm / 10) + (1 - share) * 10 ** (hidden_dbm / 10))
    path = radio.path(position_tx_ned_m=(AWAY_M, 30.0, -UA_M), position_rx_ned_m=(AWAY_M, 0.0, -UA_M))
    path = path._replace(emitters_ned_m={"tower": np.array([0.0, 0.0, -TOWER_M])})
    assert float(radio.noise_dbm(path)) == pytest.approx(watt_dbm, abs=1e-6)
    assert watt_dbm > share * seen_dbm + (1 - share) * hidden_dbm + 6.0


def test_its_fading_is_exponential_in_watt_and_its_shadowing_normal_in_db() -> None:
    mean_dbm = (
        30.0 - 20 * np.log10(4 * np.pi * CARRIER_HZ / 299_792_458.0) - 25 * np.log10(np.hypot(AWAY_M, 5.0))
    )
    faded, _ = noise_of(radio_near(tower(), fading={"model": "rayleigh"}), 3, COUNT)
    assert stats.kstest(10 ** ((faded - mean_dbm) / 10), "expon").pvalue > 1e-3
    shadowed, _ = noise_of(radio_near(tower(), shadowing={"model": "normal", "sigma_db": 6.0}), 4, COUNT)
    assert stats.kstest((shadowed - mean_dbm) / 6.0, "norm").pvalue > 1e-3


def test_the_probability_of_delivery_is_averaged_over_it() -> None:
    """Both ways Rayleigh: a wanted power of S and an unwanted of I beat an SNR of T with chance S / (S + T I)."""
    radio = {"fading": {"model": "rayleigh"}, "error": {"model": "threshold", "snr_min_db": 10.0}}
    _, chance = noise_of(radio_near(tower(power_dbm=16.0), **radio), 5)
    wanted = 10 ** ((18.0 - 25 * np.log10(30.0)) / 10)
    unwanted = 10 ** ((16.0 - 25 * np.log10(np.hypot(AWAY_M, 5.0))) / 10)
    assert chance == pytest.approx(wanted / (wanted + 10.0 * unwanted), abs=0.01)


@pytest.mark.parametrize(("offset_hz", "bandwidth_hz", "captured_db"), [(0, 20e6, -21.9), (5e6, 130e3, None)])
def test_a_narrow_radio_takes_its_share_of_a_wide_emitter_and_nothing_5_mhz_off(
    offset_hz: float, bandwidth_hz: float, captured_db: float | None
) -> None:
    beside = tower(frequency_hz=CARRIER_HZ + offset_hz, bandwidth_hz=bandwidth_hz)
    noise_dbm, _ = noise_of(radio_near(beside, bandwidth_hz=130e3), 1)
    full_dbm, _ = noise_of(radio_near(tower(), bandwidth_hz=130e3), 1)
    expected_dbm = -180.0 if captured_db is None else full_dbm[0] + captured_db
    assert noise_dbm[0] == pytest.approx(expected_dbm, abs=0.2)


@pytest.mark.parametrize(
    "law",
    [
        {"shadowing": {"model": "gudmundson", "sigma_db": 8.0, "decorrelation_m": 30.0}},
        {
            "shadowing": {
                "model": "gudmundson",
                "sigma_db": 8.0,
                "decorrelation_m": 30.0,
                "surroundings": "own",
            }
        },
        {"fading": {"model": "rician", "k_db": 3.0, "coherence": "doppler"}},
        {
            "propagation": {"model": "uma-av", "outside": "clamp"},
            "shadowing": {"model": "gudmundson", "decorrelation_m": 30.0},
        },
    ],
)
def test_radios_of_all_networks_and_sensors_see_an_emitter_alike(law: dict[str, object]) -> None:
    """What lasts lies between two places: who listens there changes nothing."""
    radio = radio_near(tower(), **law)
    config = SensorConfig(radio=radio.config, step_db=0.001)
    places = Places(np.array([[AWAY_M, 0.0, -UA_M]])), Places(np.array([[0.0, 0.0, -TOWER_M]]))
    for seed in range(5):
        measured = Sensing({"1": config}, [tower()], seed=seed).measure(0, *places)
        drawn = measured.mean_power_dbm + measured.shadowing_db + measured.fading_db
        noises_dbm = [float(noise_of(radio, seed, network=name)[0][0]) for name in ("", "mesh")]
        assert noises_dbm == pytest.approx([float(drawn[0])] * 2, abs=2e-3)
