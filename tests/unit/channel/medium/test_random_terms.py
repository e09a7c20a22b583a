"""Draws of the random terms against their theoretical laws (Kolmogorov-Smirnov at 1e-3)."""

import numpy as np
import pytest

from channel import presets
from channel.draws import Draws, Purpose, uniform_from_words
from channel.fading.laws import Nakagami, Rayleigh, Rician, coherence_block, coherence_time_s
from channel.fading.shadow_field import ShadowField
from channel.fading.shadowing import NormalShadowing, OneSidedNormalShadowing, standard_normal_from_uniform
from channel.link.radio import Radio
from channel.medium.random_terms import RandomTerms
from channel.phy.bursts import GilbertElliott, Timeline

N = 4000


def uniforms(purpose, seed=5):
    words = Draws(seed).words(("0", "1", purpose.stream), 0, N)
    return uniform_from_words(words[:, purpose.word])


def p_value(sample, law):
    from scipy.stats import kstest

    return kstest(sample, law).pvalue


def gains(model):
    level = np.zeros(())
    return 10.0 ** (model.gain_db(uniforms(Purpose.FADING_I), uniforms(Purpose.FADING_Q), level) / 10.0)


def test_rayleigh_amplitude():
    from scipy.stats import rayleigh

    assert p_value(np.sqrt(gains(Rayleigh())), rayleigh(scale=np.sqrt(0.5)).cdf) > 1e-3


@pytest.mark.parametrize("k_db", [-10.0, 3.0, 12.0])
def test_rician_amplitude(k_db):
    from scipy.stats import rice

    k = 10.0 ** (k_db / 10.0)
    law = rice(np.sqrt(2.0 * k), scale=np.sqrt(0.5 / (k + 1.0)))
    assert p_value(np.sqrt(gains(Rician(k_db=k_db))), law.cdf) > 1e-3


@pytest.mark.parametrize("m", [0.5, 1.0, 4.0])
def test_nakagami_amplitude(m):
    from scipy.stats import nakagami

    assert p_value(np.sqrt(gains(Nakagami(m=m))), nakagami(m).cdf) > 1e-3


def test_shadowing_laws():
    from scipy.stats import halfnorm, norm

    normal = standard_normal_from_uniform(uniforms(Purpose.SHADOWING))
    assert p_value(OneSidedNormalShadowing(sigma_db=6.0).loss_db(normal), halfnorm(scale=6.0).cdf) > 1e-3
    assert p_value(NormalShadowing(sigma_db=4.0).loss_db(normal), norm(scale=4.0).cdf) > 1e-3


@pytest.mark.parametrize("model", [Rayleigh(), Nakagami(m=0.7), Rician(k_db=-5.0), Rician(k_db=30.0)])
def test_quadrature_rules_have_mean_power_one(model):
    gain_db, weights = model.rule(np.array([0.0, 45.0]), 32)
    weights = np.broadcast_to(weights, np.broadcast_shapes(gain_db.shape, weights.shape))
    assert np.sum(weights, axis=-1) == pytest.approx(1.0, abs=1e-6)
    assert np.sum(weights * 10.0 ** (gain_db / 10.0), axis=-1) == pytest.approx(1.0, abs=1e-6)


def test_rician_k_rises_with_elevation():
    model = Rician(k_db=0.0, k_overhead_db=20.0)
    assert model.k_ratio(np.array([0.0, 45.0, 90.0])) == pytest.approx([1.0, 10.0, 100.0])


def field_samples(lags_m, fields=1500):
    """Values of many independent fields at points along a line; every pair of nodes has its own."""
    draws = Draws(11)
    field = ShadowField(draws, 50.0)
    rx = np.stack([np.array([500.0, lag, -40.0]) for lag in lags_m])
    here = np.array([0.0, 0.0, -40.0])
    rows = []
    for k in range(fields):
        name = f"n{k}"
        rows.append([float(field.standard_normal("a", (name,), here, place[np.newaxis])[0]) for place in rx])
    return np.array(rows)


def test_shadow_field_is_normal_with_gudmundsons_autocorrelation():
    from scipy.stats import norm

    lags = np.array([0.0, 10.0, 25.0, 50.0, 100.0, 250.0])
    samples = field_samples(lags)
    assert p_value(samples[:, 0], norm.cdf) > 1e-3
    correlation = np.corrcoef(samples.T)[0]
    theory = np.exp(-lags / 50.0)
    margin = 3.29 * (1.0 - theory**2) / np.sqrt(len(samples)) + 1e-9
    assert np.all(np.abs(correlation - theory) <= margin)


def test_shadow_field_is_reciprocal_and_has_no_memory():
    here, there = np.array([0.0, 0.0, -40.0]), np.array([300.0, 20.0, -50.0])
    one, other = ShadowField(Draws(1), 50.0), ShadowField(Draws(1), 50.0)
    out = one.standard_normal("b", ("a", "c"), here, np.stack((there, there)))
    other.standard_normal("c", ("b",), there, here[np.newaxis])
    assert other.standard_normal("a", ("b",), there, here[np.newaxis])[0] == pytest.approx(out[0], abs=1e-9)
    assert out[0] != out[1]


def test_coherence_blocks():
    assert float(coherence_time_s(np.asarray(20.0), 2.4e9, 1.0)) == pytest.approx(
        9 / (16 * np.pi) / (20.0 * 2.4e9 / 299792458.0)
    )
    assert float(coherence_time_s(np.asarray(0.0), 2.4e9, 1.0)) == 1.0
    assert coherence_block(10**9, 0.5) == (28, 10**9 >> 28)


def test_block_fading_holds_for_a_block_and_is_reciprocal():
    radio = Radio(
        presets.load_radio(
            "moon2020", {"fading": {"model": "rayleigh", "coherence": "doppler", "max_coherence_s": 0.6}}
        )
    )
    path = radio.path([100.0])
    still = np.zeros(1)

    def gain(tx, rx, time_ns):
        return float(RandomTerms(radio, Draws(3)).fading_db(tx, (rx,), time_ns, path, still)[0])

    block_ns = 1 << 29
    assert gain("0", "1", 0) == gain("1", "0", block_ns - 1) != gain("0", "1", block_ns)


def test_bursts_have_their_share_and_length():
    model = GilbertElliott(mean_good_s=0.9, mean_bad_s=0.1, loss_good=0.0, loss_bad=1.0)
    step_ns = 5_000_000
    states = np.array([Timeline(Draws(s), "0", "1").is_bad(model, 0) for s in range(2000)])
    assert abs(states.mean() - 0.1) < 3.29 * np.sqrt(0.09 / 2000)
    line = Timeline(Draws(4), "0", "1")
    bad = np.array([line.is_bad(model, k * step_ns) for k in range(200_000)])
    starts = np.count_nonzero(bad[1:] & ~bad[:-1])
    assert bad.mean() == pytest.approx(0.1, abs=0.015)
    assert np.count_nonzero(bad) * step_ns / 1e9 / starts == pytest.approx(0.1, rel=0.1)
    assert model.mean_loss == pytest.approx(0.1)


def test_timeline_does_not_depend_on_where_it_is_read_first():
    model = GilbertElliott(mean_good_s=0.5, mean_bad_s=0.5)
    late_first = Timeline(Draws(4), "0", "1")
    late_first.is_bad(model, 500 * 10**9)
    early_first = Timeline(Draws(4), "0", "1")
    times = [k * 10**8 for k in range(2000)]
    assert [early_first.is_bad(model, t) for t in times] == [late_first.is_bad(model, t) for t in times]
