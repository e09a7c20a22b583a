"""The tridiagonal precision of shadowing along lines is the inverse of the dense covariance."""

import numpy as np
import pytest

from channel.fit.correlated.field import Precision, places_of

DISTANCE_M = np.array([40.0, 10.0, 25.5, 40.0, 80.0, 12.0, 20.0])
LINK = np.array([0, 0, 0, 0, 0, 1, 1])


def dense_covariance(sigma_db, decorrelation_m):
    """Of the places in order: link 0 at 10, 25.5, 40, 80 m, link 1 at 12, 20 m."""
    at = np.array([10.0, 25.5, 40.0, 80.0, 12.0, 20.0])
    link = np.array([0, 0, 0, 0, 1, 1])
    same = link[:, np.newaxis] == link
    return np.where(same, sigma_db**2 * np.exp(-np.abs(at[:, np.newaxis] - at) / decorrelation_m), 0.0)


@pytest.fixture
def places():
    return places_of(DISTANCE_M, LINK)


def test_a_place_that_is_passed_again_is_the_same_place(places):
    assert places.of_packet.tolist() == [2, 0, 1, 2, 3, 4, 5]
    assert places.extent_m == 70.0


def test_the_precision_is_the_inverse_of_the_covariance(places):
    covariance = dense_covariance(6.0, 25.0)
    precision = Precision.of(places, 6.0, 25.0)
    product = np.column_stack([precision.times(column) for column in covariance.T])
    assert product == pytest.approx(np.eye(6), abs=1e-6)
    assert precision.log_determinant == pytest.approx(-np.linalg.slogdet(covariance)[1], abs=1e-6)


def test_weights_solutions_and_variances_are_those_of_the_dense_matrix(places):
    weight = np.array([0.0, 3.0, 0.5, 0.0, 2.0, 0.1])
    matrix = np.linalg.inv(dense_covariance(4.0, 60.0)) + np.diag(weight)
    joined = Precision.of(places, 4.0, 60.0).joined(weight)
    right = np.arange(12.0).reshape(6, 2)
    assert joined.solve(right) == pytest.approx(np.linalg.solve(matrix, right), rel=1e-5)
    assert joined.variance == pytest.approx(np.diag(np.linalg.inv(matrix)), rel=1e-5)
    assert joined.log_determinant == pytest.approx(np.linalg.slogdet(matrix)[1], abs=1e-5)
