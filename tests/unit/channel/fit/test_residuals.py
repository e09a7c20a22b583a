"""The test of dependence: blind to independent packets, sure of correlated ones."""

import numpy as np
import pytest

from channel.fit.residuals import DEPENDENT, along, chance_of_independence


def test_chances_of_independent_residuals_are_even():
    rng = np.random.Generator(np.random.PCG64(3))
    order = np.arange(400)
    scale = np.exp(np.sin(order / 30.0))  # variances may differ
    chances = [chance_of_independence(scale * rng.standard_normal(400), order) for _ in range(300)]
    assert np.mean(chances) == pytest.approx(0.5, abs=0.06)
    assert 5 <= np.count_nonzero(np.array(chances) < 0.05) <= 30


def test_neighbours_that_are_alike_are_seen_in_their_order_only():
    rng = np.random.Generator(np.random.PCG64(4))
    walk = np.convolve(rng.standard_normal(500), np.ones(20), "same")
    assert chance_of_independence(walk, np.arange(500)) < DEPENDENT
    assert chance_of_independence(walk, rng.permutation(500)) > DEPENDENT


def test_packets_go_in_the_order_of_places_link_by_link():
    order = along(np.array([5.0, 1.0, 3.0, 2.0]), np.array([0, 1, 0, 1]))
    assert order.tolist() == [2, 0, 1, 3]
