"""Which logged values are drawn, and as what: estimates as ellipses, plans as lines.

The convention, for any agent; places are in the fleet's frame, metres:

- a mapping with numbers ``north_m`` and ``east_m`` and ``covariance_m2`` (north-north, north-east, east-east) is an
  estimate: the ellipse that holds the place with a probability of 95 %, if its error is normal;
- a mapping whose ``north_m`` and ``east_m`` are lists of one length, two numbers or more, is a line.

What is not finite, or no covariance, is not drawn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

PROBABILITY = 0.95
SCALE = math.sqrt(-2.0 * math.log(1.0 - PROBABILITY))
"""Semi-axes per standard deviation, 2.448: the root of the chi-square quantile with two degrees of freedom."""
POINTS_MAX = 64
"""Of a line; of a longer one so many are drawn, evenly."""
PLACE_MAX_M = 1e7
"""What is farther off is not drawn."""
ROUNDING = 1e-9
"""A determinant may be so much below zero, relative to the variances."""


@dataclass(frozen=True, slots=True)
class Ellipse:
    """Where something is, with a probability of 95 %; azimuth of the major axis from north over east."""

    north_m: float
    east_m: float
    semi_major_m: float
    semi_minor_m: float
    azimuth_rad: float

    def __str__(self) -> str:
        axes = f"{2.0 * self.semi_major_m:.1f} x {2.0 * self.semi_minor_m:.1f} m"
        return f"ellipse, {100.0 * PROBABILITY:.0f} %: {axes}"


@dataclass(frozen=True, slots=True)
class Line:
    """A way over places (north, east), at most POINTS_MAX of them."""

    places_m: tuple[tuple[float, float], ...]

    def __str__(self) -> str:
        return f"line of {len(self.places_m)} points"


Shape = Ellipse | Line


def shape_of(value: Any) -> Shape | None:
    """What a logged value is drawn as; None: it is not."""
    if not isinstance(value, dict):
        return None
    north, east = value.get("north_m"), value.get("east_m")
    if isinstance(north, list) and isinstance(east, list):
        return _line(north, east)
    place = _floats([north, east], PLACE_MAX_M)
    covariance = value.get("covariance_m2")
    if place is None or not isinstance(covariance, list) or len(covariance) != 3:
        return None
    terms = _floats(covariance, PLACE_MAX_M**2)
    return None if terms is None else _ellipse(place, *terms.tolist())


def _line(north: list[Any], east: list[Any]) -> Line | None:
    count = len(north)
    if count != len(east) or count < 2:
        return None
    kept = np.unique(np.linspace(0, count - 1, min(count, POINTS_MAX)).round().astype(int)).tolist()
    places = [_floats([north[number], east[number]], PLACE_MAX_M) for number in kept]
    found = tuple((float(place[0]), float(place[1])) for place in places if place is not None)
    return Line(found) if len(found) == len(kept) else None


def _ellipse(place: NDArray[np.float64], nn: float, ne: float, ee: float) -> Ellipse | None:
    """By the closed form of a symmetric 2 x 2 matrix: mean of its eigenvalues, and half their difference."""
    mean, half = (nn + ee) / 2.0, math.hypot((nn - ee) / 2.0, ne)
    least = mean - half
    if least < -ROUNDING * abs(mean):
        return None
    major_m, minor_m = (SCALE * math.sqrt(max(0.0, variance)) for variance in (mean + half, least))
    if major_m > PLACE_MAX_M:
        return None
    return Ellipse(float(place[0]), float(place[1]), major_m, minor_m, 0.5 * math.atan2(2.0 * ne, nn - ee))


def _floats(values: Sequence[Any], most: float) -> NDArray[np.float64] | None:
    """As an array, if all of them are numbers within +-``most``."""
    if not all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return None
    if not all(abs(value) <= most for value in values):  # NaN is not, either
        return None
    return np.array(values, dtype=np.float64)
