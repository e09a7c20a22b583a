"""Terrain: a grid of heights, lines of sight over it and what the worst edge on the way costs."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from channel.checks import ChannelInputError, FloatArray
from channel.geometry import Path
from channel.propagation.diffraction import knife_edge_loss_db
from channel.propagation.path_loss import friis_db
from channel.units import wavelength_m
from channel.variant import Variant


class Terrain(Variant):
    """Free space plus the diffraction loss of the single worst edge of the terrain under the way.

    The ground is flat with hills on it: the curvature of the Earth, 0.2 m of bulge at 3.5 km, is left out.
    Heights are read between grid points bilinearly; outside the grid the ground is as at its border.
    """

    needs_places: ClassVar[bool] = True
    model: Literal["terrain"] = "terrain"
    origin_north_m: float = Field(default=0.0, description="of the first row")
    origin_east_m: float = Field(default=0.0, description="of the first column")
    spacing_m: float = Field(gt=0.0)
    heights_m: tuple[tuple[float, ...], ...] = Field(description="rows go north, columns east")
    step_m: float = Field(default=10.0, gt=0.0, description="between samples of a profile")

    @model_validator(mode="after")
    def _is_a_grid(self) -> Terrain:
        widths = {len(row) for row in self.heights_m}
        if len(self.heights_m) < 2 or len(widths) != 1 or widths < {2}:
            raise ValueError("heights_m: at least two rows and two columns, all rows of one length")
        return self

    def height_m(self, north_m: FloatArray, east_m: FloatArray) -> FloatArray:
        """Return the height of the ground, bilinear between grid points."""
        grid = np.asarray(self.heights_m)
        row = np.clip((north_m - self.origin_north_m) / self.spacing_m, 0.0, grid.shape[0] - 1.0)
        column = np.clip((east_m - self.origin_east_m) / self.spacing_m, 0.0, grid.shape[1] - 1.0)
        i = np.minimum(row.astype(np.intp), grid.shape[0] - 2)
        j = np.minimum(column.astype(np.intp), grid.shape[1] - 2)
        u, v = row - i, column - j
        low = grid[i, j] * (1.0 - v) + grid[i, j + 1] * v
        high = grid[i + 1, j] * (1.0 - v) + grid[i + 1, j + 1] * v
        return np.asarray(low * (1.0 - u) + high * u)

    def line_of_sight(self, path: Path) -> NDArray[np.bool_]:
        """Return whether nothing stands between the ends, in the broadcast shape of the path, as booleans."""
        return np.less(self._worst_nu(path), 0.0)

    def path_loss_db(self, path: Path) -> FloatArray:
        """Return free-space plus knife-edge loss, dB."""
        edge_db = knife_edge_loss_db(self._worst_nu(path))
        return friis_db(path.distance_m, path.frequency_hz) + edge_db

    def _worst_nu(self, path: Path) -> FloatArray:
        """Return the largest Fresnel-Kirchhoff parameter h sqrt(2 d / (lambda d1 d2)) along each way."""
        if path.position_tx_ned_m is None or path.position_rx_ned_m is None:
            raise ChannelInputError(
                "position_tx_ned_m", None, "positions of both ends: terrain lies under them"
            )
        start, end = np.broadcast_arrays(path.position_tx_ned_m, path.position_rx_ned_m)
        north_m, east_m = np.moveaxis((end - start)[..., :2], -1, 0)
        ground_m = np.sqrt(north_m * north_m + east_m * east_m)  # same bits everywhere: it counts the samples
        parts = np.maximum(np.ceil(ground_m / self.step_m), 2.0)[..., np.newaxis]
        k = np.arange(1.0, float(np.max(parts, initial=2.0)))
        inside = k < parts  # each way has samples of its own, whatever the other ways are
        t = np.where(inside, k, 1.0) / parts
        points = start[..., np.newaxis, :] + t[..., np.newaxis] * (end - start)[..., np.newaxis, :]
        clearance = self.height_m(points[..., 0], points[..., 1]) + points[..., 2]
        distance = np.asarray(path.distance_m)[..., np.newaxis]
        reach = np.sqrt(
            2.0 / (np.asarray(wavelength_m(path.frequency_hz))[..., np.newaxis] * distance * t * (1.0 - t))
        )
        return np.asarray(np.max(np.where(inside, clearance * reach, -np.inf), axis=-1))
