"""Draws of the random terms against their theoretical laws (Kolmogorov-Smirnov at 1e-3)."""

import numpy as np
import pytest

from channel import presets
from channel.draws import Draws, LinkDraws, Purpose, uniform_from_words
from channel.fading.laws import Nakagami, Rayleigh, Rician, coherence_blocks, coherence_time_s
from channel.fading.shadow_field import ShadowField
from channel.fading.shadowing import NormalShadowing, OneSidedNormalShadowing, standard_normal_from_uniform
from channel.link.radio import Radio
from channel.medium.links import Links
from channel.medium.random_terms import RandomTerms
from channel.medium.reception import Packets
from channel.phy.bursts import GilbertElliott, Timelines

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
    field = ShadowField(LinkDraws(Draws(11), ["a", *(f"n{k}" for k in range(fields))]), 50.0)
    rx = np.arange(1, fields + 1)
    here = np.array([0.0, 0.0, -40.0])
    places = [np.tile((500.0, lag, -40.0), (fields, 1)) for lag in lags_m]
    return np.stack([field.standard_normal(0 * rx, rx, here, place) for place in places], axis=1)


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
    here, there = np.array([[0.0, 0.0, -40.0]]), np.array([[300.0, 20.0, -50.0]])
    one, other = (ShadowField(LinkDraws(Draws(1), "bac"), 50.0) for _ in range(2))
    b, a, c = (np.array([i]) for i in range(3))
    out = one.standard_normal(np.repeat(b, 2), np.append(a, c), np.repeat(here, 2, 0), np.repeat(there, 2, 0))
    other.standard_normal(c, b, there, here)
    assert other.standard_normal(a, b, there, here)[0] == pytest.approx(out[0], abs=1e-9)
    assert out[0] != out[1]


def test_coherence_blocks():
    assert float(coherence_time_s(np.asarray(20.0), 2.4e9, 1.0)) == pytest.approx(
        9 / (16 * np.pi) / (20.0 * 2.4e9 / 299792458.0)
    )
    assert float(coherence_time_s(np.asarray(0.0), 2.4e9, 1.0)) == 1.0
    octave, number = coherence_blocks(np.array([10**9, 7, 5]), np.array([0.5, 2.0**-30, 2**40 / 1e9]))
    assert octave.tolist() == [28, 0, 40]
    assert number.tolist() == [10**9 >> 28, 7, 0]


def test_block_fading_holds_for_a_block_and_is_reciprocal():
    fading = {"model": "rayleigh", "coherence": "doppler", "max_coherence_s": 0.6}
    radio = Radio(presets.load_radio("moon2020", {"shadowing": {"model": "none"}, "fading": fading}))
    still = np.zeros((1, 3))

    def gain(tx, rx, time_ns):
        packets = Packets(*(np.array([each]) for each in (time_ns, int(tx), 0, 40, int(rx))))
        row, ends = np.array([0]), (packets.tx, packets.to)
        links = Links(packets, row, *ends, radio.path([100.0]), np.array([100.0]), still, still)
        return float(RandomTerms(radio, LinkDraws(Draws(3), "01")).gain_db(links, {})[0])

    block_ns = 1 << 29
    assert gain("0", "1", 0) == gain("1", "0", block_ns - 1) != gain("0", "1", block_ns)


def states(seed, model, times_ns, timelines=None):
    """Whether the link from 0 to 1 is bad at instants."""
    lines = timelines or Timelines(LinkDraws(Draws(seed), "01"))
    ends = np.zeros(len(times_ns), dtype=np.intp), np.ones(len(times_ns), dtype=np.intp)
    return lines.are_bad(model, *ends, np.asarray(times_ns))


def test_bursts_have_their_share_and_length():
    model = GilbertElliott(mean_good_s=0.9, mean_bad_s=0.1, loss_good=0.0, loss_bad=1.0)
    step_ns = 5_000_000
    at_start = np.array([states(s, model, [0])[0] for s in range(2000)])
    assert abs(at_start.mean() - 0.1) < 3.29 * np.sqrt(0.09 / 2000)
    bad = states(4, model, np.arange(200_000) * step_ns)
    starts = np.count_nonzero(bad[1:] & ~bad[:-1])
    assert bad.mean() == pytest.approx(0.1, abs=0.015)
    assert np.count_nonzero(bad) * step_ns / 1e9 / starts == pytest.approx(0.1, rel=0.1)
    assert model.mean_loss == pytest.approx(0.1)


def test_timelines_do_not_depend_on_where_or_with_whom_they_are_read_first():
    model = GilbertElliott(mean_good_s=0.5, mean_bad_s=0.5)
    times_ns = np.arange(0, 300_000_000_000, 70_000_000)
    in_order = states(4, model, times_ns)
    lines = Timelines(LinkDraws(Draws(4), "01"))
    for start in (4000, 0, 2000):
        part = times_ns[start : start + 300]
        assert np.array_equal(states(4, model, part, lines), in_order[start : start + 300])
    back = np.random.Generator(np.random.PCG64(1)).permutation(len(times_ns))
    assert np.array_equal(states(4, model, times_ns[back], lines), in_order[back])
    crowd = Timelines(LinkDraws(Draws(4), ["2", "0", "1"]))
    tx, rx = np.tile((1, 2, 0), 500), np.tile((2, 1, 2), 500)
    bad = crowd.are_bad(model, tx, rx, np.repeat(times_ns[:500], 3)).reshape(-1, 3)
    assert np.array_equal(bad[:, 0], in_order[:500])
    assert 0.2 < np.mean(bad[:, 1] != bad[:, 0]) < 0.8


def first_sojourns(seed, model, count):
    """Ends of the first states by the same draws, one at a time."""
    draws, end_ns = Draws(seed), 0.0
    starts_bad = uniform_from_words(draws.words(("0", "1", "bursts"), 0, 1))[0, 1] < model.bad_share
    for k in range(count):
        uniform = uniform_from_words(draws.words(("0", "1", "bursts"), k, 1))[0, 0]
        bad = (k % 2 == 1) != starts_bad
        end_ns += round(-np.log(uniform) * (model.mean_bad_s if bad else model.mean_good_s) * 1e9)
        yield bad, end_ns


def test_states_end_where_their_draws_say():
    model = GilbertElliott(mean_good_s=0.5, mean_bad_s=0.02)
    for bad, end_ns in first_sojourns(9, model, 200):
        found = states(9, model, np.array([end_ns - 1, end_ns]).astype(np.int64))
        assert found.tolist() == [bad, not bad]
