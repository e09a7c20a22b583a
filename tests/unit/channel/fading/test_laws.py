"""Draws of the random terms against their theoretical laws (Kolmogorov-Smirnov at 1e-3)."""

import numpy as np
import pytest

from channel.draws import Draws, Purpose, uniform_from_words
from channel.fading.laws import Nakagami, Rayleigh, Rician, scatter_gain_db
from channel.fading.shadowing import NormalShadowing, OneSidedNormalShadowing, standard_normal_from_uniform

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


@pytest.mark.parametrize("m", [0.5, 0.8, 1.0, 3.0, 20.0])
def test_nakagami_of_scatter_is_the_quantile_of_its_law(m):
    from scipy.stats import gamma

    power = np.geomspace(1e-9, 30.0, 300)
    gain_db = Nakagami(m=m).gain_of_scatter_db(np.sqrt(power) + 0j, np.ones(1) + 0j, np.zeros(()))
    by_scipy = gamma(m, scale=1.0 / m).isf(np.exp(-power))
    below = power < 1e-3
    by_scipy[below] = gamma(m, scale=1.0 / m).ppf(-np.expm1(-power[below]))
    assert gain_db == pytest.approx(10.0 * np.log10(by_scipy), abs=1e-3)


def test_a_law_of_a_user_gets_the_power_and_the_phase_of_the_scatter():
    class Own:
        def gain_db(self, first, second, _elevation_deg):
            return np.stack((first, second))

    scatter = np.array([0.5j, -2.0 + 0.1j])
    first, second = scatter_gain_db(Own(), scatter, np.ones(2) + 0j, np.zeros(()))
    assert first == pytest.approx(np.exp([-0.25, -4.01]))
    assert second == pytest.approx([0.75, 0.5 + np.arctan2(0.1, -2.0) / (2.0 * np.pi)])
