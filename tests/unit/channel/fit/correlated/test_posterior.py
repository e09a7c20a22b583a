"""Samples of densities whose quantiles are known."""

import numpy as np
import pytest
from scipy.stats import norm

from channel.fit.correlated.posterior import climbed, mixture_quantile, quantile, sample

CENTRE = np.array([3.0, -90.0])
COVARIANCE = np.array([[0.04, 0.15], [0.15, 1.0]])


def normal(at):
    apart = at - CENTRE
    return float(-0.5 * apart @ np.linalg.solve(COVARIANCE, apart))


def skew(at):
    """A log-density whose first coordinate has the law of the log of an exponential variable."""
    return float(at[0] - np.exp(at[0]) - 0.5 * at[1] ** 2)


def test_a_climb_ends_at_the_top_and_knows_its_width():
    top = climbed(normal, np.array([1.0, -80.0]), np.array([0.1, 0.5]), np.array([1.0, 5.0]))
    assert top.at == pytest.approx(CENTRE, abs=0.02)
    assert top.covariance == pytest.approx(COVARIANCE, rel=0.05)


def test_quantiles_of_a_normal_and_of_a_skew_law():
    top = climbed(normal, CENTRE + 0.1, np.array([0.1, 0.5]), np.array([1.0, 5.0]))
    points = sample(normal, top)
    for level in (0.05, 0.5, 0.95):
        expected = norm.ppf(level, CENTRE[1], 1.0)
        assert quantile(points.at[:, 1], points.weight, level) == pytest.approx(expected, abs=0.3)
    top = climbed(skew, np.zeros(2), np.array([0.3, 0.3]), np.array([2.0, 2.0]))
    points = sample(skew, top)
    for level in (0.1, 0.5, 0.9):
        expected = np.log(-np.log(1.0 - level))
        assert quantile(points.at[:, 0], points.weight, level) == pytest.approx(expected, abs=0.25)


def test_a_mixture_of_normals():
    mean, deviation, weight = np.array([0.0, 10.0]), np.array([1.0, 2.0]), np.array([0.5, 0.5])
    assert mixture_quantile(mean, deviation, weight, 0.25) == pytest.approx(0.0, abs=1e-3)
    assert mixture_quantile(mean, deviation, weight, 0.75) == pytest.approx(10.0, abs=1e-3)
