"""The verdict on a run: what it must not say of a right one, and must say of a wrong one."""

import gc
import tracemalloc

import numpy as np
import pytest

from channel import presets
from channel.link.gain_law import chance_of_less
from channel.link.radio import Radio
from channel.medium.judge.check import Verdict
from channel.medium.judge.judge import Judge
from tests.unit.channel.medium.judge.flights import NODES, Other, reach_m, verdict_of

RECEPTIONS = 10_000
FEWER = 4_000
"""Enough to see what is wrong."""


def radio(name, changes=None):
    return Radio(presets.load_radio(name, changes or {}))


def test_nothing_drawn_is_nothing_judged():
    assert not Judge(NODES).verdict().judged
    assert Verdict(()).passed


def test_a_judge_keeps_little_of_each_packet_that_it_looks_at():
    """Long flights have thousands: with the paths of their links they were nearly all that a run grew by."""
    own, judge = radio("corrected"), Judge(NODES)
    tracemalloc.start()
    try:
        verdict = verdict_of(own, judge, 3, FEWER // 4, reach_m(own))
        kept_bytes = tracemalloc.get_traced_memory()[0]
        del judge
        gc.collect()
        kept_bytes -= tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    sizes = {each.name: each.size for each in verdict.checks}
    looks = sizes["level of the powers"] + 2 * sizes["powers from packet to packet"]
    assert looks > 300
    assert kept_bytes < 1500 * looks


@pytest.mark.parametrize("name", ["moon2020", pytest.param("wifi-2.4", marks=pytest.mark.slow), "disk"])
def test_a_right_run_passes(name):
    own = radio(name)
    verdict = verdict_of(own, Judge(NODES), 3, RECEPTIONS, reach_m(own))
    assert verdict.judged
    assert verdict.passed, verdict.checks


@pytest.mark.parametrize(
    ("changes", "check"),
    [
        ({"propagation": {"exponent": 2.4}}, "level of the powers"),
        pytest.param({"shadowing": {"sigma_db": 5.0}}, "spread of the powers", marks=pytest.mark.slow),
        pytest.param({"noise": {"noise_figure_db": 7.0}}, "noise", marks=pytest.mark.slow),
        pytest.param({"base_loss": 0.08}, "base loss", marks=pytest.mark.slow),
    ],
)
def test_a_wrong_run_fails_by_what_is_wrong(changes, check):
    said = radio("wifi-2.4")
    verdict = verdict_of(radio("wifi-2.4", changes), Other(said), 4, FEWER, reach_m(said))
    assert check in [each.name for each in verdict.checks if not each.passed]


def test_losses_against_the_error_rate_fail():
    said = radio("moon2020")
    wrong = radio("moon2020", {"error": {"model": "uncoded-awgn", "modulation": "qpsk"}})
    verdict = verdict_of(wrong, Other(said), 4, FEWER, reach_m(said))
    assert not {each.name: each for each in verdict.checks}["losses"].passed


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"fading": {"model": "rayleigh"}},
        {"fading": {"model": "rician", "k_db": 6.0, "k_overhead_db": 12.0}, "shadowing": {"model": "none"}},
        {"shadowing": {"model": "one-sided-normal", "sigma_db": 5.0}},
        {"propagation": {"model": "uma-av"}, "shadowing": {"model": "normal", "sigma_db": None}},
    ],
)
def test_the_law_of_the_gain_is_that_of_its_draws(changes):
    """Drawn by hand from the laws' definitions; the oracle is the sample's own share below each gain."""
    each = radio("corrected", changes)
    rng = np.random.Generator(np.random.PCG64(6))
    where = {"ground_distance_m": [900.0], "height_tx_m": 25.0, "height_rx_m": 60.0}
    path = each.path(**where)
    n = 40_000
    z, u, v = rng.standard_normal(n), *rng.random((2, n))
    if each.sight is None:
        gain = -each.config.shadowing.loss_db(z)
    else:
        seen, hidden = each.sight.states(path)
        state = np.where(rng.random(n) < seen.chance[0], 0, 1)
        excess = np.array([seen.excess_db[0], hidden.excess_db[0]])[state]
        gain = -excess + np.array([seen.sigma_db[0], hidden.sigma_db[0]])[state] * z
    gain = gain + each.config.fading.gain_db(u, v, path.elevation_deg[0])
    for share in (0.01, 0.2, 0.5, 0.9, 0.999):
        chance = float(chance_of_less(each, path, np.quantile(gain, [share]))[0])
        assert abs(chance - share) < 3.5 * np.sqrt(share * (1 - share) / n) + 1e-3
