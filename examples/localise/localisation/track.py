"""Readings of one emitter by one sensor, made independent of each other, and what they say of a grid of places.

Shadowing makes neighbouring readings alike. Each is therefore taken as a normal variable given those before it that
were measured nearest (Vecchia 1988; Datta et al. 2016, "nearest-neighbor Gaussian process"): with NEIGHBOURS or fewer
readings that is the exact joint law, with more an approximation whose cost grows in proportion to the readings. Order
is that of the sensor's numbers, so that a sum does not depend on when a reading came.
"""

from __future__ import annotations

import bisect
from typing import NamedTuple

import numpy as np

from localisation.model import Floats, MeanPower, Reading, Spread

NEIGHBOURS = 40
ROOM = 128
"""Readings by which its arrays grow."""


class Whitened(NamedTuple):
    """Independent normal variables of variance 1, in place of n readings.

    Attributes:
        residuals: readings less their means, shape (n, ...).
        ones: what 1 dB more power does to each, shape (n,).
    """

    residuals: Floats
    ones: Floats


class Track:
    """A set of readings; the same set gives the same bits, in whatever order and however often they came.

    Args:
        grid_ned_m: shape (G, 3).
        mean_power: the law.
        spread: of readings about it.

    Attributes:
        squares: sum of the squares of whitened residuals at each place of the grid, shape (G,).
        cross: sum of their products with what 1 dB more power does, shape (G,).
        ones: sum of the squares of the latter.
    """

    def __init__(self, grid_ned_m: Floats, mean_power: MeanPower, spread: Spread) -> None:
        self._grid, self._mean_power, self._spread = grid_ned_m, mean_power, spread
        self._readings: list[Reading] = []
        self._numbers: list[int] = []
        self._restart()

    def _restart(self) -> None:
        self._done = 0
        self._places, self._powers = np.zeros((0, 3)), np.zeros(0)
        self._residuals = np.empty((0, len(self._grid)))
        self._near = np.zeros((0, NEIGHBOURS), dtype=np.intp)
        self._weights = np.zeros((0, NEIGHBOURS))
        self._sigma_db, self._ones = np.zeros(0), np.zeros(0)
        self.squares = np.zeros(len(self._grid))
        self.cross = np.zeros(len(self._grid))
        self.ones = 0.0

    def __len__(self) -> int:
        return len(self._readings)

    @property
    def numbers(self) -> tuple[int, ...]:
        """Of the readings that it has."""
        return tuple(self._numbers)

    @property
    def places_ned_m(self) -> Floats:
        """Where they were taken, shape (n, 3)."""
        return np.array([each.place_ned_m for each in self._readings]).reshape(-1, 3)

    def add(self, reading: Reading) -> bool:
        """Take a reading; False, and nothing changes, if it is there already."""
        at = bisect.bisect_left(self._numbers, reading.number)
        if at < len(self._numbers) and self._numbers[at] == reading.number:
            return False
        self._numbers.insert(at, reading.number)
        self._readings.insert(at, reading)
        if at < self._done:
            self._restart()
        return True

    def update(self) -> None:
        """Bring the sums up to date."""
        if self._done == len(self._readings):
            return
        places = self._places = self.places_ned_m
        self._powers = np.array([each.power_dbm for each in self._readings])
        for k in range(self._done, len(places)):
            if k == len(self._residuals):
                self._make_room()
            self._residuals[k] = self._powers[k] - self._mean_power(self._grid, places[k])
            near, weights, sigma_db = _given_neighbours(places[: k + 1], self._spread)
            self._near[k, : len(near)], self._weights[k, : len(near)] = near, weights
            white = (self._residuals[k] - weights @ self._residuals[near]) / sigma_db
            one = (1.0 - float(np.sum(weights))) / sigma_db
            self._sigma_db[k], self._ones[k] = sigma_db, one
            self.squares += white * white
            self.cross += one * white
            self.ones += one * one
        self._done = len(places)

    def _make_room(self) -> None:
        for name in ("_residuals", "_near", "_weights", "_sigma_db", "_ones"):
            old = getattr(self, name)
            setattr(self, name, np.concatenate([old, np.zeros((ROOM, *old.shape[1:]), dtype=old.dtype)]))

    def whitened(self, at_ned_m: Floats) -> Whitened:
        """Residuals of all readings at some places, shape (n, len(at_ned_m)); as of the newest `update`."""
        plain = self._powers[:, np.newaxis] - self._mean_power(at_ned_m, self._places[:, np.newaxis, :])
        near, weights = self._near[: self._done], self._weights[: self._done]
        given = np.einsum("nm,nmc->nc", weights, np.take(plain, near, axis=0))
        return Whitened((plain - given) / self._sigma_db[: self._done, np.newaxis], self._ones[: self._done])


def _given_neighbours(places_ned_m: Floats, spread: Spread) -> tuple[np.ndarray, Floats, float]:
    """Which of those before the last reading are nearest to it, their weights in its mean, and its sigma given them."""
    away = np.sqrt(np.sum((places_ned_m[:-1] - places_ned_m[-1]) ** 2, axis=-1))
    near = np.sort(np.argsort(away, kind="stable")[:NEIGHBOURS])
    common = spread.shadowing(away[near])
    weights = np.linalg.solve(spread.covariance(places_ned_m[near]), common) if len(near) else common
    variance = spread.shadowing_db**2 + spread.white_db**2 - float(common @ weights)
    return near, weights, float(np.sqrt(variance))
