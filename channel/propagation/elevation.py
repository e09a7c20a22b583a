"""Heights of the ground from a GeoTIFF, an SRTM tile or what else GDAL reads.

By `rasterio`, the extra `lostlink[terrain]`. They are read once, onto a level grid of metres north and east of the
run's origin.
"""

from __future__ import annotations

import importlib
import re
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from channel.checks import FloatArray

EXTRA = "lostlink[terrain]"
M_PER_DEG = 111_318.84502145034
"""ArduPilot's scale of latitude (`LATLON_TO_M` is that of 1e-7 degree), in which the positions of a run are."""
MAX_POINTS = 16_000_000
ROWS_AT_ONCE = 16
"""Of the grid; so much of the file is in memory."""
LOWEST_M, HIGHEST_M = -12_000.0, 9_000.0
"""Of the Earth, sea floor with it: other numbers are gaps that a file does not declare, or a wrong scale."""
METRES = "m", "metre", "metres", "meter", "meters"
"""First words of what files have for units of metres, in capitals or not."""


class ElevationError(ValueError):
    """A file of heights that cannot be used: the message names it and says why."""


class TerrainOrigin(NamedTuple):
    """Where a run's frame has its zero: WGS 84, height above mean sea level as the file has it."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float


def library() -> ModuleType:
    """Return rasterio.

    Raises:
        ElevationError: it is not installed; the message names the extra.
    """
    try:
        return importlib.import_module("rasterio")
    except ImportError as error:
        raise ElevationError(f"needs the library rasterio: pip install '{EXTRA}'") from error


def read_elevation(file: Path, origin: TerrainOrigin, extent_m: float, spacing_m: float) -> FloatArray:
    """Return heights above the origin's, rows going north from -extent_m, columns east, to the millimetre, m.

    Bilinear between the file's points, with its scale and offset; kept until the file changes.

    Raises:
        ElevationError: the file cannot be read, does not cover the square, has gaps in it, heights in feet, or such
            as are nowhere on Earth.
    """
    try:
        return _read(file, file.stat().st_mtime_ns, origin, extent_m, spacing_m)
    except OSError as error:
        raise ElevationError(f"cannot read {file}: {error.strerror or error}") from error


@lru_cache(maxsize=4)
def _read(
    file: Path, _changed_ns: int, origin: TerrainOrigin, extent_m: float, spacing_m: float
) -> FloatArray:
    count = 2 * int(np.ceil(extent_m / spacing_m)) + 1
    if count * count > MAX_POINTS:
        raise ElevationError(f"{count:g} by {count:g} points: at most {MAX_POINTS}; take a larger spacing_m")
    axis = (np.arange(count) - count // 2) * spacing_m
    north, east = np.meshgrid(axis, axis, indexing="ij")
    lat_deg = origin.lat_deg + north / M_PER_DEG
    scale = np.cos(np.radians(0.5 * (lat_deg + origin.lat_deg)))
    lon_deg = origin.lon_deg + east / (M_PER_DEG * scale)
    heights_m = _sampled(file, lat_deg, lon_deg)
    return np.asarray(np.round(heights_m - origin.alt_amsl_m, 3))


def _sampled(file: Path, lat_deg: FloatArray, lon_deg: FloatArray) -> FloatArray:
    rasterio = library()
    try:
        with rasterio.open(file) as data:
            if data.crs is None:
                raise ElevationError(f"{file}: has no coordinate system")
            unit = re.search("[a-z]+", (data.units[0] or "m").lower())
            if unit and unit.group() not in METRES:
                raise ElevationError(f"{file}: its heights are in {data.units[0]}: has to be metres")
            column, row = _pixels(data, lat_deg, lon_deg)
            inside = (
                (row >= 0.0) & (column >= 0.0) & (row <= data.height - 1.0) & (column <= data.width - 1.0)
            )
            if not inside.all():
                share = 100.0 * float(np.mean(inside))
                raise ElevationError(
                    f"{file}: covers {share:.0f} % of the square of extent_m about the origin"
                )
            return _bilinear(file, data, row, column)
    except rasterio.errors.RasterioError as error:
        raise ElevationError(f"cannot read {file}: {error}") from error


def _pixels(data: Any, lat_deg: FloatArray, lon_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return columns and rows, counted from the middle of the first pixel."""
    warp = importlib.import_module("rasterio.warp")
    x, y = warp.transform("EPSG:4326", data.crs, lon_deg.ravel().tolist(), lat_deg.ravel().tolist())
    x, y = np.reshape(x, lat_deg.shape), np.reshape(y, lat_deg.shape)
    to_pixel = ~data.transform
    column = to_pixel.a * x + to_pixel.b * y + to_pixel.c
    row = to_pixel.d * x + to_pixel.e * y + to_pixel.f
    return column - 0.5, row - 0.5


def _bilinear(file: Path, data: Any, row: FloatArray, column: FloatArray) -> FloatArray:
    parts = [slice(begin, begin + ROWS_AT_ONCE) for begin in range(0, len(row), ROWS_AT_ONCE)]
    return np.concatenate([_bilinear_part(file, data, row[part], column[part]) for part in parts])


def _bilinear_part(file: Path, data: Any, row: FloatArray, column: FloatArray) -> FloatArray:
    top, left = int(np.min(row)), int(np.min(column))
    bottom, right = min(int(np.max(row)) + 2, data.height), min(int(np.max(column)) + 2, data.width)
    band = data.read(1, window=((top, bottom), (left, right)), masked=True).astype(np.float64)
    if np.ma.is_masked(band) or not np.isfinite(band).all():
        raise ElevationError(f"{file}: has gaps within extent_m of the origin")
    heights_m = np.asarray(band) * data.scales[0] + data.offsets[0]
    wrong_m = heights_m[~((heights_m >= LOWEST_M) & (heights_m <= HIGHEST_M))]
    if wrong_m.size:
        raise ElevationError(
            f"{file}: has a height of {wrong_m[0]:g} m within extent_m of the origin, and Earth has {LOWEST_M:g} to "
            f"{HIGHEST_M:g} m: see its nodata value, scale and offset"
        )
    return interpolated(heights_m, row - top, column - left)


def interpolated(grid: FloatArray, row: FloatArray, column: FloatArray) -> FloatArray:
    """Return values of a grid at fractions of rows and columns that lie in it, bilinear between its points."""
    i = np.minimum(row.astype(np.intp), grid.shape[0] - 2)
    j = np.minimum(column.astype(np.intp), grid.shape[1] - 2)
    u, v = row - i, column - j
    low = grid[i, j] * (1.0 - v) + grid[i, j + 1] * v
    high = grid[i + 1, j] * (1.0 - v) + grid[i + 1, j + 1] * v
    return np.asarray(low * (1.0 - u) + high * u)
