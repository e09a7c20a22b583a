"""The line of sight as a random state: the mixture of both, and what a medium draws."""

import numpy as np
import pytest
from scipy.stats import norm

from channel import presets
from channel.fading.shadowing import NormalShadowing
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.presets import PresetError

GEOMETRY = {"height_tx_m": 25.0, "height_rx_m": 60.0}
PLACED = {"model": "gudmundson", "decorrelation_m": 37.0}


def radio(propagation="uma-av", **changes):
    return Radio(presets.load_radio("corrected", {"propagation": {"model": propagation}, **changes}))


def test_delivery_is_the_mixture_over_both_states():
    """The figures of a mixture made by hand from both states, each with 6 dB of shadowing."""
    found = radio().probability_of_delivery(ground_distance_m=[1500.0, 2000.0], **GEOMETRY)
    assert found == pytest.approx([0.561, 0.402], abs=5e-4)


def test_the_mean_in_db_is_there_to_compare_with():
    tree = {"propagation": {"model": "uma-av", "line_of_sight": "expected"}}
    by_mean = Radio(presets.load_radio("corrected", tree))
    found = by_mean.probability_of_delivery(ground_distance_m=[1500.0, 2000.0], **GEOMETRY)
    assert found == pytest.approx([0.375, 0.118], abs=5e-4)


def threshold_chance(height_m, sigmas_db, ground_m=1500.0):
    """P(SNR >= 10 dB) of a normal law in each state, by tables B-1 to B-3 of TR 36.777 at 2 GHz, bases at 25 m."""
    slant = np.log10(np.hypot(ground_m, height_m - 25.0))
    losses = (
        28 + 22 * slant + 20 * np.log10(2.0),
        -17.5 + (46 - 7 * np.log10(height_m)) * slant + 20 * np.log10(40 * np.pi * 2 / 3),
    )
    d1, p1 = max(460 * np.log10(height_m) - 700, 18), 4300 * np.log10(height_m) - 3800
    seen = d1 / ground_m + np.exp(-ground_m / p1) * (1 - d1 / ground_m)
    margins = [20.0 - loss + 100.0 - 10.0 for loss in losses]
    return seen * norm.cdf(margins[0] / sigmas_db[0]) + (1 - seen) * norm.cdf(margins[1] / sigmas_db[1])


THRESHOLD = {
    "frequency_hz": 2e9,
    "transmit_power_dbm": 20.0,
    "antenna": {"model": "isotropic", "gain_db": 0.0},
    "earth_radius_factor": None,
    "noise": {"model": "fixed", "floor_dbm": -100.0},
    "error": {"model": "threshold", "snr_min_db": 10.0},
}


@pytest.mark.parametrize("height_m", [30.0, 60.0, 95.0])
def test_each_state_has_its_own_sigma(height_m):
    where = {"ground_distance_m": 1500.0, "height_tx_m": 25.0, "height_rx_m": height_m}
    by_hand = {"sigma_db": 3.0, "sigma_without_sight_db": 8.0}
    own = radio(**THRESHOLD, shadowing={"model": "normal", **by_hand})
    assert own.probability_of_delivery(**where) == pytest.approx(threshold_chance(height_m, (3, 8)), abs=1e-6)
    table = radio(**THRESHOLD, shadowing={**PLACED, "sigma_db": None})
    sigmas = 4.64 * np.exp(-0.0066 * height_m), 6.0
    assert table.probability_of_delivery(**where) == pytest.approx(
        threshold_chance(height_m, sigmas), abs=1e-6
    )


@pytest.mark.parametrize("shadowing", [{"model": "normal", "sigma_db": 6.0}, {**PLACED, "sigma_db": None}])
def test_the_table_of_a_medium_is_as_good_as_the_quadrature(shadowing):
    each = radio(shadowing=shadowing)
    heights = np.linspace(24.0, 99.0, 12)
    where = {"ground_distance_m": np.full(12, 1800.0), "height_tx_m": 25.0, "height_rx_m": heights}
    found = each.expected_delivery(**where, length_bytes=40)
    assert found == pytest.approx(each.probability_of_delivery(**where, length_bytes=40), abs=3e-5)


def test_a_sigma_of_its_own_needs_a_table():
    with pytest.raises(PresetError, match=r"shadowing\.sigma_db: is missing"):
        presets.load_radio("corrected", {"shadowing": {"sigma_db": None}})
    with pytest.raises(PresetError, match=r"shadowing\.sigma_db: is missing"):
        radio("al-hourani", shadowing={"sigma_db": None})
    assert NormalShadowing(sigma_db=3.0).in_sight(False) == 3.0


def powers_dbm(tx_ned_m, rx_ned_m, swap=False):
    """Received powers along a track of the aircraft, without shadowing."""
    medium = Medium(radio(shadowing={"model": "none"}), seed=8, nodes=["base", "ua"], bases=["base"])
    medium.place("base", tx_ned_m)
    medium.place("ua", rx_ned_m[0])
    sender = "ua" if swap else "base"
    out = []
    for seq, place in enumerate(rx_ned_m):
        medium.place("ua", place)
        medium.send(medium.packets(tx=sender, seq=seq, sim_time_ns=seq * 10**9, length_bytes=40))
        out += medium.settle().received_power_dbm.tolist()
    return np.array(out)


def test_the_drawn_state_lasts_along_a_track_and_is_the_same_for_both_directions():
    base = (0.0, 0.0, -25.0)
    track = [(1200.0, float(east), -60.0) for east in range(0, 3800, 4)]
    power_dbm = powers_dbm(base, track)
    states = [
        Radio(
            presets.load_radio("corrected", {"propagation": {"model": "uma-av", "line_of_sight": which}})
        ).link(position_tx_ned_m=base, position_rx_ned_m=track)
        for which in ("always", "never")
    ]
    seen, hidden = (np.abs(power_dbm - state.received_power_dbm) < 1e-3 for state in states)
    assert np.all(seen ^ hidden)
    changes = np.count_nonzero(seen[1:] != seen[:-1])
    assert 10 < changes < 250  # of independent draws there would be 400 and more
    assert np.array_equal(powers_dbm(base, track[:50], swap=True), power_dbm[:50])
