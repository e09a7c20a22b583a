"""Logged values as shapes: ellipses against eigenvalues and draws, lines, and what is neither."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lostlink.view.picture.shapes import POINTS_MAX, Ellipse, Line, shape_of

CHI_SQUARE_95 = 5.991464547107979
"""Quantile with two degrees of freedom, from tables."""


def estimate(nn: float, ne: float, ee: float, **more: Any) -> dict[str, Any]:
    return {"north_m": 12.0, "east_m": -7.0, "covariance_m2": [nn, ne, ee], "readings": 3, **more}


@pytest.mark.parametrize(
    ("terms", "azimuth_deg"),
    [
        ((100.0, 0.0, 25.0), 0.0),
        ((25.0, 0.0, 100.0), 90.0),
        ((50.0, 30.0, 50.0), 45.0),
        ((50.0, -30.0, 50.0), -45.0),
    ],
)
def test_the_major_axis_points_where_the_spread_is_greatest(
    terms: tuple[float, float, float], azimuth_deg: float
) -> None:
    found = shape_of(estimate(*terms))
    assert isinstance(found, Ellipse)
    assert (found.north_m, found.east_m) == (12.0, -7.0)
    assert math.degrees(found.azimuth_rad) == pytest.approx(azimuth_deg)


@given(st.floats(-math.pi, math.pi), st.floats(0.1, 900.0), st.floats(0.1, 900.0))
def test_axes_are_those_of_the_eigenvalues(turn_rad: float, a_m: float, b_m: float) -> None:
    turn = np.array([[math.cos(turn_rad), -math.sin(turn_rad)], [math.sin(turn_rad), math.cos(turn_rad)]])
    covariance = turn @ np.diag([a_m**2, b_m**2]) @ turn.T
    found = shape_of(estimate(covariance[0, 0], covariance[0, 1], covariance[1, 1]))
    assert isinstance(found, Ellipse)
    values, vectors = np.linalg.eigh(covariance)
    axes = np.sqrt(CHI_SQUARE_95 * values)
    assert [found.semi_minor_m, found.semi_major_m] == pytest.approx(axes.tolist(), rel=1e-4)
    if values[1] > 1.01 * values[0]:
        major = np.array([math.cos(found.azimuth_rad), math.sin(found.azimuth_rad)])
        assert abs(major @ vectors[:, 1]) == pytest.approx(1.0, abs=1e-6)


def test_nineteen_of_twenty_draws_are_inside() -> None:
    covariance = np.array([[90.0, -40.0], [-40.0, 30.0]])
    found = shape_of(estimate(90.0, -40.0, 30.0))
    assert isinstance(found, Ellipse)
    draws = np.random.default_rng(1).multivariate_normal((12.0, -7.0), covariance, 100_000) - (12.0, -7.0)
    c, s = math.cos(found.azimuth_rad), math.sin(found.azimuth_rad)
    along, across = draws @ (c, s), draws @ (-s, c)
    inside = (along / found.semi_major_m) ** 2 + (across / found.semi_minor_m) ** 2 < 1.0
    assert inside.mean() == pytest.approx(0.95, abs=0.003)  # four standard deviations of the share


def test_a_place_that_is_known_exactly_is_a_point() -> None:
    found = shape_of(estimate(0.0, 0.0, 0.0))
    assert isinstance(found, Ellipse)
    assert found.semi_major_m == found.semi_minor_m == 0.0


def test_a_plan_is_a_line() -> None:
    found = shape_of({"after_s": [0, 6, 12], "north_m": [0, 10, 20], "east_m": [5.0, 5.0, 9.0]})
    assert found == Line(((0.0, 5.0), (10.0, 5.0), (20.0, 9.0)))


def test_a_long_line_keeps_its_ends() -> None:
    found = shape_of({"north_m": list(range(1000)), "east_m": [0.0] * 1000})
    assert isinstance(found, Line)
    assert len(found.places_m) == POINTS_MAX
    assert (found.places_m[0], found.places_m[-1]) == ((0.0, 0.0), (999.0, 0.0))


@pytest.mark.parametrize(
    "value",
    [
        None, 1.5, "north_m", [1.0, 2.0], {}, {"north_m": 1.0, "east_m": 2.0},
        estimate(1.0, 2.0, 1.0), estimate(-1.0, 0.0, 1.0), estimate(math.nan, 0.0, 1.0), estimate(math.inf, 0.0, 1.0),
        estimate(1e300, 0.0, 1e300), estimate(1.0, 0.0, 1.0, north_m=math.nan), estimate(1.0, 0.0, 1.0, north_m=None),
        estimate(1.0, 0.0, 1.0, north_m=True), estimate(1.0, 0.0, 1.0, east_m=10**400),
        estimate(1.0, 0.0, 1.0, covariance_m2=[1.0, 1.0]), estimate(1.0, 0.0, 1.0, covariance_m2=["1", 0, 1]),
        estimate(1.0, 0.0, 1.0, covariance_m2=[[1, 0], [0, 1]]),
        {"north_m": [1.0], "east_m": [2.0]}, {"north_m": [1.0, 2.0], "east_m": [2.0]}, {"north_m": [], "east_m": []},
        {"north_m": [1.0, math.nan], "east_m": [2.0, 3.0]}, {"north_m": [1.0, None], "east_m": [2.0, 3.0]},
        {"north_m": [1.0, 2.0], "east_m": 3.0}, {"north_m": [[1], [2]], "east_m": [[1], [2]]},
        {"north_m": [0.0, 1e300], "east_m": [0.0, 0.0]},
    ],
)  # fmt: skip
def test_what_is_no_shape_is_not_drawn(value: Any) -> None:
    assert shape_of(value) is None
