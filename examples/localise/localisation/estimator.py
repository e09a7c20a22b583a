"""Where an emitter is: the posterior of its place, a function of the set of readings and of nothing else.

A uniform prior over the area searched, a normal one over the emitter's power (which readings shift by the same dB, so
that it is integrated out in closed form), and the law of readings. While much of the area is possible the posterior
is summed over a grid: powers measured on a line fit two places, and no Kalman filter would hold both. Once it is a
few cells wide, the most likely place is found by Gauss-Newton steps, and the covariance is that of the law's linear
form there (Laplace).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from localisation.model import Floats, MeanPower, Reading, Spread, slopes
from localisation.track import Track

FINE_CELLS = 1.5
"""A posterior of a larger sigma than so many cells, in every direction, is summed over the grid."""
STEPS = 25
CLOSE_M = 0.02
"""A step that is shorter than this leads nowhere that matters."""
POINTS = 9


@dataclass(frozen=True, slots=True)
class Area:
    """Where an emitter can be: a rectangle at one height.

    Attributes:
        north_m: least and most.
        east_m: likewise.
        height_m: of emitters above the fleet's origin.
        cell_m: of the grid.
    """

    north_m: tuple[float, float]
    east_m: tuple[float, float]
    height_m: float = 2.0
    cell_m: float = 15.0

    def grid(self) -> Floats:
        """Centres of cells, NED, shape (G, 3)."""
        axes = [
            low + (np.arange(count := max(1, round((high - low) / self.cell_m))) + 0.5) * (high - low) / count
            for low, high in (self.north_m, self.east_m)
        ]
        north, east = np.meshgrid(*axes, indexing="ij")
        return np.stack([north.ravel(), east.ravel(), np.full(north.size, -self.height_m)], axis=-1)

    def holds(self, north_m: float, east_m: float) -> bool:
        """Return whether a place is in it."""
        return self.north_m[0] <= north_m <= self.north_m[1] and self.east_m[0] <= east_m <= self.east_m[1]


class Estimate(NamedTuple):
    """What is known of an emitter.

    Attributes:
        place_m: north and east, shape (2,).
        covariance_m2: shape (2, 2).
        information: of north, east and power (1/m^2, 1/(m dB), 1/dB^2), shape (3, 3).
        points_m: places that stand for the posterior, each as likely as another, shape (P, 2).
        readings: how many it is from.
        is_fine: found by Gauss-Newton; False: summed over the grid.
    """

    place_m: Floats
    covariance_m2: Floats
    information: Floats
    points_m: Floats
    readings: int
    is_fine: bool


class Estimator:
    """One emitter's place, from readings of any number of sensors.

    Args:
        area: where it can be.
        mean_power: mean reading at the power that is believed.
        spread: of readings about it.
    """

    def __init__(self, area: Area, mean_power: MeanPower, spread: Spread) -> None:
        self._area, self._mean_power, self._spread = area, mean_power, spread
        self._grid = area.grid()
        self._tracks: dict[str, Track] = {}

    def add(self, node: str, reading: Reading) -> bool:
        """Take a reading of a node; False, and nothing changes, if it is there already."""
        if node not in self._tracks:
            self._tracks[node] = Track(self._grid, self._mean_power, self._spread)
        return self._tracks[node].add(reading)

    def places_ned_m(self, node: str) -> Floats:
        """Where a node's readings were taken, shape (n, 3)."""
        return self._tracks[node].places_ned_m if node in self._tracks else np.zeros((0, 3))

    def has(self, node: str) -> tuple[int, ...]:
        """Numbers of the readings of a node."""
        return self._tracks[node].numbers if node in self._tracks else ()

    def estimate(self) -> Estimate:
        """What the readings say."""
        for track in self._in_order():
            track.update()
        coarse = self._summed()
        cells = self._area.cell_m * FINE_CELLS
        if np.linalg.eigvalsh(coarse.covariance_m2)[-1] > cells * cells:
            return coarse
        return self._refined(coarse) or coarse

    def _in_order(self) -> Iterator[Track]:
        return (self._tracks[node] for node in sorted(self._tracks))

    def log_likelihood(self) -> Floats:
        """Of each place of the grid, up to a constant, shape (G,); as of the newest `estimate`."""
        squares, cross, ones = (
            np.zeros(len(self._grid)),
            np.zeros(len(self._grid)),
            self._spread.power_precision,
        )
        for track in self._in_order():
            squares, cross, ones = squares + track.squares, cross + track.cross, ones + track.ones
        return -0.5 * (squares - cross * cross / ones)

    def _summed(self) -> Estimate:
        weights = np.exp((likely := self.log_likelihood()) - np.max(likely))
        weights /= np.sum(weights)
        places = self._grid[:, :2]
        mean = weights @ places
        away = places - mean
        covariance = (weights[:, np.newaxis] * away).T @ away + np.eye(2) * self._area.cell_m**2 / 12.0
        cumulative = np.cumsum(weights)
        shares = (np.arange(POINTS) + 0.5) / POINTS
        points = places[np.minimum(np.searchsorted(cumulative, shares), len(places) - 1)]
        information = np.zeros((3, 3))
        information[:2, :2] = np.linalg.inv(covariance)
        information[2, 2] = self._spread.power_precision
        readings = sum(len(track) for track in self._in_order())
        return Estimate(mean, covariance, information, points, readings, is_fine=False)

    def _refined(self, coarse: Estimate) -> Estimate | None:
        """The most likely place and the law's linear form there; None if no step leads there within the area."""
        place = self._grid[int(np.argmax(self.log_likelihood()))].copy()
        cost, step, information = self._linear(place)
        for _ in range(STEPS):
            shift = np.linalg.solve(information, step)[:2]
            if np.hypot(*shift) < CLOSE_M:
                break
            scale = 1.0
            while scale > 1e-3:
                trial = place + np.array([*(scale * shift), 0.0])
                trial_cost, trial_step, trial_information = self._linear(trial)
                if trial_cost <= cost:
                    break
                scale *= 0.5
            else:
                break
            place, cost, step, information = trial, trial_cost, trial_step, trial_information
        covariance = np.linalg.inv(information)[:2, :2]
        if not self._area.holds(place[0], place[1]) or not np.all(np.isfinite(covariance)):
            return None
        spread = np.linalg.cholesky(covariance)
        signs = np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        points = place[:2] + 1.4 * signs @ spread.T
        return Estimate(place[:2], covariance, information, points, coarse.readings, is_fine=True)

    def _linear(self, place_ned_m: Floats) -> tuple[float, Floats, Floats]:
        """Cost (twice the negative logarithm), and right side and matrix of the normal equations at a place."""
        steps = np.array(
            [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [-0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, -0.5, 0.0]]
        )
        right, matrix, squares = np.zeros(3), np.zeros((3, 3)), 0.0
        matrix[2, 2] = self._spread.power_precision
        for track in self._in_order():
            residuals, ones = track.whitened(place_ned_m + steps)
            rates = np.stack(
                [residuals[:, 2] - residuals[:, 1], residuals[:, 4] - residuals[:, 3], ones], axis=-1
            )
            right += rates.T @ residuals[:, 0]
            matrix += rates.T @ rates
            squares += float(residuals[:, 0] @ residuals[:, 0])
        return squares - right[2] ** 2 / matrix[2, 2], right, matrix


def bound_m2(
    mean_power: MeanPower, spread: Spread, emitter_ned_m: Floats, tracks_ned_m: list[Floats]
) -> Floats:
    """The Cramer-Rao bound of north and east, m^2, shape (2, 2): of any unbiased estimate from these readings.

    From the full covariance of each sensor's readings, with no neighbours left out; inf if they do not determine it.

    Args:
        mean_power: the law.
        spread: of readings about it.
        emitter_ned_m: where it is.
        tracks_ned_m: where each sensor measured, each of shape (n, 3).
    """
    information = np.diag([0.0, 0.0, spread.power_precision])
    for places in tracks_ned_m:
        if len(places):
            rates = np.concatenate(
                [slopes(mean_power, emitter_ned_m, places), np.ones((len(places), 1))], axis=-1
            )
            information += rates.T @ np.linalg.solve(spread.covariance(places), rates)
    if np.linalg.cond(information) > 1e15:
        return np.full((2, 2), np.inf)
    return np.linalg.inv(information)[:2, :2]
