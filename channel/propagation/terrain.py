"""Terrain: a grid of heights, lines of sight over it and what the edges on the way cost."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path as FilePath
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from channel.checks import ChannelInputError, FloatArray
from channel.geometry import MIN_HEIGHT_M, Path
from channel.numbers.units import wavelength_m
from channel.propagation.diffraction import Profile, bulge_m, bullington_db, edge_db, worst_nu
from channel.propagation.elevation import TerrainOrigin, interpolated, library, read_elevation
from channel.propagation.path_loss import PathLossModel, friis_db
from channel.validity import OutsideValidityError

EDGE_M = 1e-6
"""By which a place may lie beyond the grid and still counts as on its border."""


class Terrain(PathLossModel):
    """Free space plus the diffraction loss of the terrain under the way, and of the Earth's bulge with it.

    `edges: bullington` is P.526's construction for any number of edges, `worst` the loss of the one that reaches
    highest into the way. Heights are read bilinearly between the points of a grid, `heights_m`, or of a `file`
    (GeoTIFF, SRTM; see `elevation`). Antennas are at least 0.1 m above the ground.
    """

    needs_places: ClassVar[bool] = True
    has_earth: ClassVar[bool] = True
    model: Literal["terrain"] = "terrain"
    heights_m: tuple[tuple[float, ...], ...] | None = Field(
        default=None, description="above the run's origin; rows go north, columns east"
    )
    origin_north_m: float = Field(default=0.0, description="of the first row of heights_m")
    origin_east_m: float = Field(default=0.0, description="of the first column of heights_m")
    file: str | None = Field(default=None, description="GeoTIFF or SRTM tile, as seen from the YAML file")
    origin_lat_deg: float | None = Field(
        default=None, ge=-90.0, le=90.0, description="of the run; for a file"
    )
    origin_lon_deg: float | None = Field(default=None, ge=-180.0, le=180.0)
    origin_alt_amsl_m: float | None = Field(default=None, description="of the run's height 0, as in the file")
    extent_m: float = Field(
        default=5000.0, gt=0.0, description="of a file, how far about the origin it is read"
    )
    spacing_m: float = Field(default=30.0, ge=0.01, description="between points of the grid")
    step_m: float = Field(default=10.0, ge=0.1, description="between samples of a profile")
    edges: Literal["bullington", "worst"] = "bullington"
    earth_radius_factor: float | None = Field(default=4.0 / 3.0, ge=0.1, description="null: a flat Earth")
    outside: Literal["refuse", "border"] = Field(
        default="refuse", description="beyond the grid: an error, or the ground as at its border"
    )

    @model_validator(mode="after")
    def _has_ground(self) -> Terrain:
        if (self.heights_m is None) == (self.file is None):
            raise ValueError("has to have either heights_m or file")
        if self.heights_m is not None:
            widths = {len(row) for row in self.heights_m}
            if len(self.heights_m) < 2 or len(widths) != 1 or widths < {2}:
                raise ValueError("heights_m: at least two rows and two columns, all rows of one length")
            if "spacing_m" not in self.model_fields_set:
                raise ValueError("spacing_m is missing, between the points of heights_m")
        elif self._origin is None:
            library()
        else:
            self._ground  # noqa: B018 (reads the file, so that a mistake is reported now)
        return self

    def at_origin(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> Terrain:
        """Return the terrain with a run's origin where it has none of its own."""
        if self.file is None or self._origin is not None:
            return self
        origin = {"origin_lat_deg": lat_deg, "origin_lon_deg": lon_deg, "origin_alt_amsl_m": alt_amsl_m}
        return Terrain.model_validate(
            origin | self.model_dump(exclude_none=True) | {"earth_radius_factor": self.earth_radius_factor}
        )

    @property
    def _origin(self) -> TerrainOrigin | None:
        place = self.origin_lat_deg, self.origin_lon_deg, self.origin_alt_amsl_m
        known = [each for each in place if each is not None]
        return TerrainOrigin(*known) if len(known) == len(place) else None

    @cached_property
    def _ground(self) -> tuple[FloatArray, float, float]:
        """The grid of heights, with the place of its first point."""
        if self.heights_m is not None:
            return np.asarray(self.heights_m), self.origin_north_m, self.origin_east_m
        if self._origin is None or self.file is None:
            raise ChannelInputError(
                "origin_lat_deg, origin_lon_deg, origin_alt_amsl_m",
                None,
                "where the run's origin is, for a file",
            )
        grid = read_elevation(FilePath(self.file), self._origin, self.extent_m, self.spacing_m)
        corner = -(grid.shape[0] // 2) * self.spacing_m
        return grid, corner, corner

    def height_m(self, north_m: FloatArray, east_m: FloatArray) -> FloatArray:
        """Return the height of the ground, bilinear between the points of the grid.

        Raises:
            OutsideValidityError: a place beyond the grid, and the model is to refuse.
        """
        grid, first_north_m, first_east_m = self._ground
        row, column = (north_m - first_north_m) / self.spacing_m, (east_m - first_east_m) / self.spacing_m
        ends = grid.shape[0] - 1.0, grid.shape[1] - 1.0
        held = np.clip(row, 0.0, ends[0]), np.clip(column, 0.0, ends[1])
        if self.outside == "refuse":
            off = np.maximum(np.abs(row - held[0]), np.abs(column - held[1])) > EDGE_M
            if off.any():
                at = (
                    float(np.broadcast_to(north_m, off.shape)[off][0]),
                    float(np.broadcast_to(east_m, off.shape)[off][0]),
                )
                raise OutsideValidityError(
                    "place (north, east)",
                    at,
                    "within the terrain; `outside: border` goes on as at its border",
                )
        return interpolated(grid, *held)

    def line_of_sight(self, path: Path) -> NDArray[np.bool_]:
        """Return whether nothing stands between the ends, in the broadcast shape of the path, as booleans."""
        return np.less(worst_nu(*self._under(path)), 0.0)

    def path_loss_db(self, path: Path) -> FloatArray:
        """Return free-space plus diffraction loss, dB."""
        under = self._under(path)
        over_edges = bullington_db(*under) if self.edges == "bullington" else edge_db(worst_nu(*under))
        return friis_db(path.distance_m, path.frequency_hz) + over_edges

    def _under(self, path: Path) -> tuple[Profile, FloatArray, FloatArray, FloatArray]:
        """Return the ground under each way, the antennas' heights above its level, and wavelengths."""
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
        share = np.where(inside, k, 1.0) / parts
        points = start[..., np.newaxis, :2] + share[..., np.newaxis] * (end - start)[..., np.newaxis, :2]
        length_m = np.maximum(ground_m, 1e-3)
        along_m = share * length_m[..., np.newaxis]
        height_m = self.height_m(points[..., 0], points[..., 1])
        height_m = height_m + bulge_m(along_m, length_m[..., np.newaxis], self.earth_radius_factor)
        profile = Profile(length_m, along_m, height_m, inside)
        tx_m, rx_m = (
            np.maximum(-place[..., 2], self.height_m(place[..., 0], place[..., 1]) + MIN_HEIGHT_M)
            for place in (start, end)
        )
        return profile, tx_m, rx_m, wavelength_m(path.frequency_hz)
