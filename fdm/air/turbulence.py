"""Dryden turbulence after MIL-F-8785C, low-altitude model (3.7.2.1, 3.7.3).

Intensities and lengths depend on the height h above the ground (from 10 ft to 1000 ft):

    sigma_w = 0.1 W20                      L_w = h
    sigma_u = sigma_v = sigma_w / (0.177 + 0.000823 h)^0.4
    L_u = L_v = h / (0.177 + 0.000823 h)^1.2              (h in ft)

Above 1000 ft both intensities stay at 0.1 W20 and the lengths grow to 1750 ft at 2000 ft. The filters are
driven by the UA's speed V through the mean wind (frozen turbulence, tau = L / V) and discretised exactly, so
that the variance does not depend on the step. V leaves the turbulence itself out: with it, lulls would pass more
slowly than gusts, and the mean wind of a UA that hovers would be lower by about sigma_u^2 / V. u is a first-order
process, v and w are (1 + sqrt(3) tau s) / (1 + tau s)^2. The u axis lies along the mean wind at the start. It
follows a mean wind that turns over the length L_u, by the shorter way to its line, as u and -u are alike: so nothing
jumps where a mean wind begins, ends or turns round. JSBSim's own turbulence is not used: its random numbers are not
keyed by UA and seed.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import atan2, cos, dist, exp, pi, remainder, sin, sqrt

import numpy as np

from fdm.model.air_point import AirPoint, Wind
from fdm.model.truth import Vector

FOOT_M = 0.3048
AIRSPEED_MIN_MPS = 1.0
"""A UA that hovers in still air is given this speed through the frozen turbulence."""
STEP_MAX_S = 1.0
_SQRT3 = sqrt(3.0)
_BLOCK = 1500


def intensities_mps(height_m: float, w20_mps: float) -> tuple[float, float]:
    """(sigma_u = sigma_v, sigma_w) at `height_m` above the ground, m/s."""
    height_ft = min(max(height_m / FOOT_M, 10.0), 1000.0)
    sigma_w = 0.1 * w20_mps
    return sigma_w / (0.177 + 0.000823 * height_ft) ** 0.4, sigma_w


def lengths_m(height_m: float) -> tuple[float, float]:
    """(L_u = L_v, L_w) at `height_m` above the ground, m."""
    height_ft = max(height_m / FOOT_M, 10.0)
    if height_ft > 1000.0:
        length_ft = 1000.0 + 0.75 * (min(height_ft, 2000.0) - 1000.0)
        return length_ft * FOOT_M, length_ft * FOOT_M
    return height_ft / (0.177 + 0.000823 * height_ft) ** 1.2 * FOOT_M, height_ft * FOOT_M


class FirstOrder:
    """Process of unit variance with the spectrum of 1 / (1 + tau s)."""

    def __init__(self, normal: float) -> None:
        self._x = normal

    def step(self, ratio: float, normals: Iterator[float]) -> float:
        """Go on by `ratio` = step / tau; gives the new value."""
        a = exp(-ratio)
        self._x = a * self._x + sqrt(1.0 - a * a) * next(normals)
        return self._x


class SecondOrder:
    """Process of unit variance with the spectrum of (1 + sqrt(3) tau s) / (1 + tau s)^2."""

    def __init__(self, first: float, second: float) -> None:
        # The stationary covariance of both states is [[1/2, 1/4], [1/4, 1/4]].
        self._x1 = first / sqrt(2.0)
        self._x2 = (first + second) / sqrt(8.0)

    def step(self, ratio: float, normals: Iterator[float]) -> float:
        """Go on by `ratio` = step / tau; gives the new value."""
        a = exp(-ratio)
        c11 = 0.5 * (1.0 - a * a)
        c12 = 0.25 * (1.0 - a * a * (1.0 + 2.0 * ratio))
        c22 = 0.25 * (1.0 - a * a * (1.0 + 2.0 * ratio + 2.0 * ratio * ratio))
        l11 = sqrt(c11)
        l21 = c12 / l11 if l11 > 0.0 else 0.0
        l22 = sqrt(max(c22 - l21 * l21, 0.0))
        n1, n2 = next(normals), next(normals)
        self._x2 = a * (self._x2 + ratio * self._x1) + l21 * n1 + l22 * n2
        self._x1 = a * self._x1 + l11 * n1
        return _SQRT3 * self._x1 + (1.0 - _SQRT3) * self._x2


class DrydenTurbulence:
    """A mean wind with turbulence on top.

    Args:
        mean: the wind without turbulence.
        w20_mps: wind at 20 ft, which sets the intensity.
        seed: of the run.
        ua_id: which UA; each has a turbulence of its own.
    """

    def __init__(self, mean: Wind, w20_mps: float, *, seed: int, ua_id: int) -> None:
        self._arguments = (mean, w20_mps, seed, ua_id)
        self._mean = mean
        self._w20_mps = w20_mps
        self._normals = _normals(seed, ua_id)
        normal = self._normals
        self._u = FirstOrder(next(normal))
        self._v = SecondOrder(next(normal), next(normal))
        self._w = SecondOrder(next(normal), next(normal))
        self._axis_rad = 0.0
        self._last_ns: int | None = None

    def __reduce__(self) -> tuple[object, ...]:
        """Pickled as new: what goes to another process is a wind that nobody has asked yet."""
        return (_from_arguments, self._arguments)

    def air_ned_mps(self, point: AirPoint) -> Vector:
        """Mean wind and turbulence at `point`."""
        north, east, down = self._mean.air_ned_mps(point)
        if self._last_ns is None:
            self._last_ns, self._axis_rad = point.sim_time_ns, atan2(east, north)
        step_s = (point.sim_time_ns - self._last_ns) / 1e9
        self._last_ns = point.sim_time_ns
        airspeed_mps = dist(point.velocity_ned_mps, (north, east, down))
        travelled_m = max(airspeed_mps, AIRSPEED_MIN_MPS) * min(max(step_s, 0.0), STEP_MAX_S)
        along, vertical = lengths_m(point.height_m)
        sigma_u, sigma_w = intensities_mps(point.height_m, self._w20_mps)
        u = sigma_u * self._u.step(travelled_m / along, self._normals)
        v = sigma_u * self._v.step(travelled_m / along, self._normals)
        w = sigma_w * self._w.step(travelled_m / vertical, self._normals)
        if north or east:
            turn_rad = remainder(atan2(east, north) - self._axis_rad, pi)
            self._axis_rad += (1.0 - exp(-travelled_m / along)) * turn_rad
        cosine, sine = cos(self._axis_rad), sin(self._axis_rad)
        return (north + u * cosine - v * sine, east + u * sine + v * cosine, down + w)


def _from_arguments(mean: Wind, w20_mps: float, seed: int, ua_id: int) -> DrydenTurbulence:
    return DrydenTurbulence(mean, w20_mps, seed=seed, ua_id=ua_id)


def _normals(seed: int, ua_id: int) -> Iterator[float]:
    """Standard normal numbers, keyed by seed and UA: no other UA's draws change them."""
    generator = np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, ua_id, 0x4457])))
    while True:
        yield from generator.standard_normal(_BLOCK).tolist()
