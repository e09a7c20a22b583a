"""Where the two ends of a link are, in what the models need: distances, heights, angles, attitudes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray

Indices = NDArray[np.intp]
Column = TypeVar("Column")
MIN_HEIGHT_M = 0.1
"""Antennas are never lower than this above the ground plane: a UA on its legs still has an aerial above it."""
LEVEL_WXYZ = np.array([1.0, 0.0, 0.0, 0.0])
NORTH = np.array([1.0, 0.0, 0.0])


class Path(NamedTuple):
    """One or many links; all fields broadcast against each other.

    Attributes:
        frequency_hz: carrier.
        distance_m: slant distance between the antennas, already clamped to the radio's minimum.
        height_tx_m: height of the transmitting antenna above ground.
        height_rx_m: height of the receiving antenna above ground.
        position_tx_ned_m: shape (..., 3), or None if only distances are known.
        position_rx_ned_m: shape (..., 3), or None.
        attitude_tx_wxyz: body to north-east-down, shape (..., 4); None: level, nose north.
        attitude_rx_wxyz: likewise.
        reflected_gain_db: what both antennas have more along the ray that flat ground reflects than along the direct
            one, or None: nothing.
        emitters_ned_m: where emitters are, by name, shape (3,) or (..., 3); None if nobody said.
        tx_is_base: whether the transmitter stands on the ground, as bases do; for laws with `needs_roles`.
        rx_is_base: likewise.
    """

    frequency_hz: float | FloatArray
    distance_m: FloatArray
    height_tx_m: float | FloatArray
    height_rx_m: float | FloatArray
    position_tx_ned_m: FloatArray | None = None
    position_rx_ned_m: FloatArray | None = None
    attitude_tx_wxyz: FloatArray | None = None
    attitude_rx_wxyz: FloatArray | None = None
    reflected_gain_db: FloatArray | None = None
    emitters_ned_m: Mapping[str, FloatArray] | None = None
    tx_is_base: bool | NDArray[np.bool_] = True
    rx_is_base: bool | NDArray[np.bool_] = False

    @property
    def ground_distance_m(self) -> FloatArray:
        """Horizontal distance between the antennas, m."""
        return np.asarray(np.sqrt(np.maximum(np.square(self.distance_m) - np.square(self._rise_m), 0.0)))

    @property
    def elevation_deg(self) -> FloatArray:
        """Elevation angle of the higher end seen from the lower one, degrees in [0, 90]."""
        return np.degrees(np.arcsin(np.minimum(np.abs(self._rise_m) / self.distance_m, 1.0)))

    @property
    def _rise_m(self) -> FloatArray:
        """How much higher tx is than rx, m; by places where they are known: in a valley, heights end at the plane."""
        if self.position_tx_ned_m is None or self.position_rx_ned_m is None:
            return np.asarray(np.subtract(self.height_tx_m, self.height_rx_m))
        return np.asarray(self.position_rx_ned_m[..., 2] - self.position_tx_ned_m[..., 2])

    @property
    def way_ned(self) -> FloatArray:
        """Unit vectors from tx to rx, shape (..., 3); due north where there are no positions, or the same."""
        if self.position_tx_ned_m is None or self.position_rx_ned_m is None:
            return np.broadcast_to(NORTH, (*np.shape(self.distance_m), 3))
        way = self.position_rx_ned_m - self.position_tx_ned_m
        length = np.sqrt(np.sum(way**2, axis=-1, keepdims=True))
        return np.where(length > 0.0, way / np.maximum(length, 1e-9), NORTH)


def reflected_ways_ned(path: Path) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors from tx and from rx to where flat ground reflects the ray between them, shape (..., 3)."""
    way = path.way_ned
    level = way[..., :2] * path.distance_m[..., np.newaxis]
    down = np.broadcast_to(np.add(path.height_tx_m, path.height_rx_m), level.shape[:-1])[..., np.newaxis]
    length = np.sqrt(np.sum(level * level, axis=-1, keepdims=True) + down * down)
    return np.concatenate((level, down), axis=-1) / length, np.concatenate((-level, down), axis=-1) / length


def separation_m(tx_ned_m: FloatArray, rx_ned_m: FloatArray) -> FloatArray:
    """Return the distance between positions of shape (..., 3), m."""
    way = rx_ned_m - tx_ned_m
    north, east, down = way[..., 0], way[..., 1], way[..., 2]
    return np.asarray(np.sqrt(north * north + east * east + down * down))


def path_at(path: Path, links: Indices) -> Path:
    """Return some of the links of a path."""
    return path._replace(
        frequency_hz=_number_at(path.frequency_hz, links),
        distance_m=path.distance_m[links],
        height_tx_m=_number_at(path.height_tx_m, links),
        height_rx_m=_number_at(path.height_rx_m, links),
        position_tx_ned_m=vectors_at(path.position_tx_ned_m, links),
        position_rx_ned_m=vectors_at(path.position_rx_ned_m, links),
        attitude_tx_wxyz=vectors_at(path.attitude_tx_wxyz, links),
        attitude_rx_wxyz=vectors_at(path.attitude_rx_wxyz, links),
        emitters_ned_m=_emitters_at(path.emitters_ned_m, links),
        tx_is_base=_number_at(path.tx_is_base, links),
        rx_is_base=_number_at(path.rx_is_base, links),
    )


def _emitters_at(places: Mapping[str, FloatArray] | None, links: Indices) -> Mapping[str, FloatArray] | None:
    """Return places of emitters for some of the links; one place for all is (3,)."""
    if places is None:
        return None
    return {name: place if place.ndim == 1 else place[links] for name, place in places.items()}


def _number_at(column: Column, links: Indices) -> Column:
    """Return some rows of a column; what is one for all links stays as it is."""
    return cast(Column, column[links]) if isinstance(column, np.ndarray) and column.ndim else column


def vectors_at(vectors: FloatArray | None, links: Indices) -> FloatArray | None:
    """Return rows of vectors; None if there are none."""
    return None if vectors is None else vectors.T.take(links, axis=1).T
